-- Cases. A column group is NULL until the case has come that far; the results of the registration and planning
-- services are kept as they came, encoded as the contract's messages.
CREATE TABLE cases (
    case_id            TEXT    NOT NULL PRIMARY KEY,
    label              TEXT    NOT NULL,
    created_at_ms      INTEGER NOT NULL,
    revision           INTEGER NOT NULL,
    model_digest       TEXT,
    lesion_spacing_mm  REAL,
    scene_digest       TEXT,
    scene_point_count  INTEGER,
    scene_has_normals  INTEGER,
    registration       BLOB,
    accepted_by        TEXT,
    plan               BLOB,
    plan_jaw_width_mm  REAL,
    plan_jaw_length_mm REAL,
    approved_by        TEXT,
    approved_digest    TEXT,
    CHECK ((approved_by IS NULL) = (approved_digest IS NULL))
) STRICT;

-- The large parts of a case, packed as they came.
CREATE TABLE case_blobs (
    case_id TEXT NOT NULL REFERENCES cases (case_id),
    kind    TEXT NOT NULL CHECK (kind IN ('VERTICES', 'TRIANGLES', 'LESION', 'SCENE', 'RESIDUALS')),
    bytes   BLOB NOT NULL,
    PRIMARY KEY (case_id, kind)
) STRICT;

CREATE TABLE procedures (
    procedure_id         TEXT    NOT NULL PRIMARY KEY,
    case_id              TEXT    NOT NULL REFERENCES cases (case_id),
    operator             TEXT    NOT NULL,
    state                TEXT    NOT NULL
        CHECK (state IN ('RUNNING', 'PAUSED', 'ABORTING', 'COMPLETED', 'ABORTED', 'INTERRUPTED')),
    plan_digest          TEXT    NOT NULL,
    bites_planned        INTEGER NOT NULL,
    next_bite            INTEGER NOT NULL,
    bites_done           INTEGER NOT NULL,
    reason               TEXT    NOT NULL,
    detail               TEXT    NOT NULL,
    started_at_ms        INTEGER NOT NULL,
    ended_at_ms          INTEGER,
    robot_seconds        REAL    NOT NULL,
    rcm_deviation_max_mm REAL    NOT NULL
) STRICT;

-- One procedure at a time, whatever the code believes.
CREATE UNIQUE INDEX one_open_procedure ON procedures ((1))
    WHERE state IN ('RUNNING', 'PAUSED', 'ABORTING', 'INTERRUPTED');

-- The journal: a step stands here as INTENDED before its first command leaves.
CREATE TABLE steps (
    procedure_id         TEXT    NOT NULL REFERENCES procedures (procedure_id),
    sequence             INTEGER NOT NULL,
    kind                 TEXT    NOT NULL,
    effect               TEXT    NOT NULL CHECK (effect IN ('PURE', 'REVERSIBLE', 'IRREVERSIBLE')),
    state                TEXT    NOT NULL CHECK (state IN ('INTENDED', 'DONE', 'FAILED', 'IN_DOUBT', 'RESOLVED')),
    bite                 INTEGER,
    operation_id         TEXT    NOT NULL UNIQUE,
    intended_at_ms       INTEGER NOT NULL,
    ended_at_ms          INTEGER,
    started_controller_s REAL    NOT NULL,
    ended_controller_s   REAL,
    detail               TEXT    NOT NULL,
    PRIMARY KEY (procedure_id, sequence)
) STRICT;

-- What the jaw did in a BITE step. A repeated bite has one row for each time.
CREATE TABLE bite_outcomes (
    procedure_id    TEXT    NOT NULL,
    sequence        INTEGER NOT NULL,
    bite            INTEGER NOT NULL,
    tip_x_mm        REAL    NOT NULL,
    tip_y_mm        REAL    NOT NULL,
    tip_z_mm        REAL    NOT NULL,
    jaw             TEXT    NOT NULL,
    peak_current_ma REAL    NOT NULL,
    PRIMARY KEY (procedure_id, sequence),
    FOREIGN KEY (procedure_id, sequence) REFERENCES steps (procedure_id, sequence)
) STRICT;
