-- Who accepted a registration in which role, and the landmarks touched for it (encoded as the contract's message). Whoever
-- accepted before roles were kept did so as an operator.
ALTER TABLE cases ADD COLUMN accepted_as TEXT;
ALTER TABLE cases ADD COLUMN accepted_at_ms INTEGER;
ALTER TABLE cases ADD COLUMN verification_basis TEXT;
ALTER TABLE cases ADD COLUMN touches BLOB;

-- Calibrations as they were saved; `result` is the answer of the registration service, encoded as the contract's message.
CREATE TABLE calibrations (
    calibration_id  TEXT    NOT NULL PRIMARY KEY,
    kind            TEXT    NOT NULL CHECK (kind IN ('HAND_EYE', 'TOOL_TIP')),
    label           TEXT    NOT NULL,
    saved_by        TEXT    NOT NULL,
    saved_at_ms     INTEGER NOT NULL,
    valid_until_ms  INTEGER NOT NULL,
    result          BLOB    NOT NULL,
    revoked_by      TEXT,
    revoked_at_ms   INTEGER,
    revoked_because TEXT,
    CHECK ((revoked_by IS NULL) = (revoked_at_ms IS NULL))
) STRICT;

-- Which calibration of a kind is in force. No row: the configured one.
CREATE TABLE calibrations_in_force (
    kind            TEXT    NOT NULL PRIMARY KEY CHECK (kind IN ('HAND_EYE', 'TOOL_TIP')),
    calibration_id  TEXT    NOT NULL REFERENCES calibrations (calibration_id),
    activated_by    TEXT    NOT NULL,
    activated_at_ms INTEGER NOT NULL
) STRICT;
