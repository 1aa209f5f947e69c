-- Who commands. A gateway that takes command raises the epoch; every write is made in a transaction that holds this
-- row at the writer's epoch, so that a gateway that was thought dead cannot write when it comes back.
CREATE TABLE command (
    row_id     INTEGER NOT NULL PRIMARY KEY CHECK (row_id = 1),
    epoch      INTEGER NOT NULL,
    holder     TEXT    NOT NULL,
    expires_ms INTEGER NOT NULL
) STRICT;
INSERT INTO command (row_id, epoch, holder, expires_ms) VALUES (1, 0, '', 0);

-- The epoch of the gateway that answers for the procedure: it started it, or took it over.
ALTER TABLE procedures ADD COLUMN epoch INTEGER NOT NULL DEFAULT 0;
