-- The audit: every command, decision, refusal, alarm and approval, each chained to the one before by its hash and
-- signed. A digest is kept as its 32 bytes, so that one value has one form; empty where there is none.
CREATE TABLE audit (
    sequence       INTEGER NOT NULL PRIMARY KEY,
    previous       BLOB    NOT NULL,
    at_ms          INTEGER NOT NULL,
    kind           TEXT    NOT NULL,
    name           TEXT    NOT NULL,
    role           TEXT    NOT NULL,
    peer           TEXT    NOT NULL,
    stated         TEXT    NOT NULL,
    method         TEXT    NOT NULL,
    case_id        TEXT    NOT NULL,
    procedure_id   TEXT    NOT NULL,
    request_digest BLOB    NOT NULL,
    plan_digest    BLOB    NOT NULL,
    answers        INTEGER NOT NULL,
    code           TEXT    NOT NULL,
    reason         TEXT    NOT NULL,
    detail         TEXT    NOT NULL,
    hash           BLOB    NOT NULL,
    key_id         TEXT    NOT NULL,
    signature      BLOB    NOT NULL
) STRICT;

CREATE INDEX audit_case ON audit (case_id, sequence);
CREATE INDEX audit_procedure ON audit (procedure_id, sequence);

-- Who approved a plan, and who did so second where two persons must.
ALTER TABLE cases ADD COLUMN approved_role TEXT;
ALTER TABLE cases ADD COLUMN approved_at_ms INTEGER;
ALTER TABLE cases ADD COLUMN countersigned_by TEXT;
ALTER TABLE cases ADD COLUMN countersigned_role TEXT;
ALTER TABLE cases ADD COLUMN countersigned_at_ms INTEGER;
