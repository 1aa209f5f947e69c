"""Recordings of the gateway read by the Python library of MCAP: `recording.py ARTHRO`.

One simulated procedure is recorded to its end and read back: schemas resolve by themselves, counts agree with `arthro record info`, times run
forward. The same file cut at many bytes reads up to its last flushed line. Then gateways are killed in the middle of a procedure: less than
100 ms are lost. What `arthro replay` shows of the whole file is what stands in it.
"""

import collections
import io
import json
import pathlib
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import time

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

GRPCURL = pathlib.Path(sys.executable).parent / "grpcurl"
KILLS = 5
LOST_LIMIT_MS = 100
CUTS = 400


def demo(arthro, folder):
    return subprocess.Popen(
        [arthro, "demo", "--keep", folder, "--report", f"{folder}/report.html", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def recordings(folder):
    return sorted(pathlib.Path(folder, "recordings").glob("*.mcap"))


def info(arthro, path):
    told = subprocess.run([arthro, "--json", "record", "info", path], check=True, capture_output=True, text=True)
    return json.loads(told.stdout.splitlines()[-1])


def times(data):
    """Log times of everything that a streaming reader gets out of a file, in order; it may end anywhere."""
    found = []
    reader = NonSeekingReader(io.BytesIO(data))
    try:
        for _, _, message in reader.iter_messages(log_time_order=False):
            found.append(message.log_time)
    except (McapError, EOFError, ValueError, struct.error):
        pass
    return found


def chunk_ends(data):
    """Where each chunk of a whole file ends, and how many messages are in the file until there."""
    position, ends, messages = 8, [], 0
    while position + 9 <= len(data) - 8:
        opcode, length = data[position], int.from_bytes(data[position + 1 : position + 9], "little")
        position += 9 + length
        if opcode == 0x06:
            chunk = data[position - length : position]
            records = chunk[8 + 8 + 8 + 4 + 4 + int.from_bytes(chunk[28:32], "little") + 8 :]
            at = 0
            while at + 9 <= len(records):
                messages += records[at] == 0x05
                at += 9 + int.from_bytes(records[at + 1 : at + 9], "little")
            ends.append((position, messages))
        if opcode == 0x0F:
            break
    return ends


def check_whole(arthro, path):
    told = info(arthro, path)
    counts, last_ns, procedure, steps = collections.Counter(), 0, None, {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert decoded.DESCRIPTOR.full_name == schema.name, schema.name
            counts[channel.topic] += 1
            assert message.log_time >= last_ns, "the reader sorts by time"
            last_ns = message.log_time
            if channel.topic == "/procedure":
                procedure = decoded
            if channel.topic == "/step":
                steps[decoded.sequence] = decoded
    assert told["whole"] and told["missing_lines"] == 0, told
    assert counts == told["lines"], (counts, told["lines"])
    assert last_ns == told["last_ns"]
    assert procedure.state == 4, "COMPLETED"
    assert sorted(steps) == list(range(1, len(steps) + 1)), "no step is missing"
    assert all(step.state == 2 for step in steps.values()), "every step is DONE"
    rate = counts["/arms"] / told["seconds"]
    print(f"whole: {sum(counts.values())} lines in {told['seconds']:.1f} s, {path.stat().st_size / 1e6:.1f} MB, {rate:.0f} states of the arms a second")
    return procedure, steps


def check_cuts(path):
    data = path.read_bytes()
    whole, ends = times(data), chunk_ends(data)
    assert ends and ends[-1][1] == len(whole), (ends[-1:], len(whole))
    for index in range(CUTS):
        cut = 8 + (len(data) - 8) * index // CUTS
        found = times(data[:cut])
        assert found == whole[: len(found)], f"cut at {cut}"
        flushed = max((messages for end, messages in ends if end <= cut), default=0)
        assert len(found) >= flushed, f"cut at {cut}: {len(found)} of {flushed}"
    print(f"cut at {CUTS} bytes: every line that was flushed is read")


def gateway_of(folder):
    """The process of the gateway whose state is in this folder."""
    for process in pathlib.Path("/proc").iterdir():
        try:
            command = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if command[1:3] == [b"serve", b"gateway"] and any(folder.encode() in word for word in command):
            return int(process.name)
    return None


def lost_ms(arthro, index):
    """Kills a gateway in the middle; how long before it the recording ends."""
    with tempfile.TemporaryDirectory() as folder:
        process = demo(arthro, folder)
        try:
            until = time.monotonic() + 120
            # Under way: the file has grown by some states.
            while not any(path.stat().st_size > 100_000 * (index + 1) for path in recordings(folder)):
                assert process.poll() is None and time.monotonic() < until, "the procedure did not get under way"
                time.sleep(0.002)
            pid = gateway_of(folder)
            assert pid is not None, "the gateway runs"
            subprocess.run(["kill", f"-{signal.SIGKILL}", str(pid)], check=True)
            killed_ns = time.time_ns()
            process.wait(timeout=60)
        finally:
            process.kill()
            process.wait()
        path = recordings(folder)[0]
        found = times(path.read_bytes())
        told = info(arthro, path)
        assert not told["whole"] and told["last_ns"] == max(found), "both readers read as far"
        return (killed_ns - max(found)) / 1e6


def check_replay(arthro, path, procedure, steps):
    command = [arthro, "replay", path, "--listen=127.0.0.1:0", "--speed=100", "--until-stdin-closes"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        address = json.loads(process.stdout.readline())["address"]

        def call(method, request):
            called = subprocess.run(
                [GRPCURL, "-plaintext", "-d", json.dumps(request), address, method], capture_output=True, text=True
            )
            return called.stdout, called.stderr

        service = "arthro.gateway.v1.ProcedureService"
        asked = {"procedureId": procedure.procedure_id}
        until = time.monotonic() + 60
        while '"COMPLETED"' not in (shown := call(f"{service}/GetReport", asked)[0]).replace("PROCEDURE_STATE_", ""):
            assert time.monotonic() < until, shown
            time.sleep(0.05)
        assert len(json.loads(shown)["steps"]) == len(steps)
        refused = call(f"{service}/StopProcedure", {})[1]
        assert '"REPLAY"' in refused, refused
    finally:
        process.stdin.close()
        process.wait(timeout=30)
    print("replay: shows the procedure to its end, refuses commands")


def main():
    arthro = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder:
        process = demo(arthro, folder)
        told, _ = process.communicate(timeout=140)
        assert process.returncode == 0, told[-2000:]
        (path,) = recordings(folder)
        procedure, steps = check_whole(arthro, path)
        check_cuts(path)
        check_replay(arthro, path, procedure, steps)
    lost = [lost_ms(arthro, index) for index in range(KILLS)]
    print(f"killed {KILLS} times: lost {', '.join(f'{ms:.0f}' for ms in lost)} ms")
    assert statistics.median(lost) < LOST_LIMIT_MS, lost


if __name__ == "__main__":
    main()
