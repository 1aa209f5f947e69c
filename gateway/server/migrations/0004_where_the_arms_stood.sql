-- Where an arm stood when a procedure was halted after a step, in its own base; 0 is before the first step. Whoever goes on
-- is held against it.
CREATE TABLE standings (
    procedure_id   TEXT    NOT NULL REFERENCES procedures (procedure_id),
    sequence       INTEGER NOT NULL,
    arm            TEXT    NOT NULL CHECK (arm IN ('FORCEPS', 'ARTHROSCOPE')),
    recorded_at_ms INTEGER NOT NULL,
    rotation_w     REAL    NOT NULL,
    rotation_x     REAL    NOT NULL,
    rotation_y     REAL    NOT NULL,
    rotation_z     REAL    NOT NULL,
    tip_x_mm       REAL    NOT NULL,
    tip_y_mm       REAL    NOT NULL,
    tip_z_mm       REAL    NOT NULL,
    PRIMARY KEY (procedure_id, sequence, arm)
) STRICT;
