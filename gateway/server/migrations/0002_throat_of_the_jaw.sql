-- The room that the hinge of the jaw needs. Plans from before it was counted were made for 1 mm.
ALTER TABLE cases ADD COLUMN plan_jaw_throat_mm REAL;
UPDATE cases SET plan_jaw_throat_mm = 1.0 WHERE plan IS NOT NULL;
