"""Counts what passed, subject by subject, and waits for things without sleeping for luck."""

import json
import time


class Failed(Exception):
    """What was waited for did not come."""


class Report:
    """PASS and FAIL lines as they come, a table and a line of JSON at the end."""

    def __init__(self):
        self.counts = {}
        self.subject = ""

    def run(self, subject, checks, *arguments):
        """One subject; what it raises is a failure of it, and the others go on."""
        self.subject = subject
        self.counts.setdefault(subject, [0, 0])
        try:
            checks(self, *arguments)
        except Exception as error:  # noqa: BLE001 a foreign client raises many kinds
            self.check(f"{subject} goes through", False, f"{type(error).__name__}: {error}")

    def check(self, name, passed, seen=""):
        """Counts one check."""
        counts = self.counts[self.subject]
        counts[0] += bool(passed)
        counts[1] += 1
        print(f"{'PASS' if passed else 'FAIL'} {name}" + (f": {seen}" if seen != "" else ""), flush=True)
        return passed

    def finish(self):
        """The table; whether everything passed."""
        passed, total = (sum(column) for column in zip(*self.counts.values()))
        width = max(map(len, self.counts))
        print(f"\n{'subject':{width}}  passed")
        for subject, counts in self.counts.items():
            print(f"{subject:{width}}  {counts[0]}/{counts[1]}" + ("" if counts[0] == counts[1] else "  FAILED"))
        print(f"{'all':{width}}  {passed}/{total}")
        print(json.dumps({"passed": passed, "total": total, "subjects": self.counts}), flush=True)
        return passed == total


def wait_for(what, limit_s, condition):
    """Asks again and again until it holds; what it then is."""
    end = time.monotonic() + limit_s
    while not (seen := condition()):
        if time.monotonic() > end:
            raise Failed(f"{what}: not within {limit_s} s")
        time.sleep(0.002)
    return seen
