"""Aligned text tables of what the methods reached, at most 120 columns wide."""

import itertools

from dataset import LEVELS

HEADS = ["", *LEVELS, *(f"TRE {level[0]}" for level in LEVELS), "TRE all", "wrong ACC", "solved REJ", "REVIEW", "s", "s p95"]


def _figure(value, form):
    return "-" if value is None else format(value, form)


def _aligned(rows):
    """First column to the left, the others to the right; a row of one cell is a heading of its own."""
    columns = max(map(len, rows))
    widths = [max(len(row[column]) for row in rows if len(row) > 1) for column in range(columns)]
    lines = []
    for first, *others in rows:
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:]))]
        lines.append(" ".join(cells).rstrip())
    return "\n".join(lines)


def results(methods, summaries):
    """One method a row: solved of each level, median TRE of the solved by level and of all, verdicts, time in seconds."""
    rows = [HEADS]
    for group, members in itertools.groupby(methods, lambda method: method.group):
        rows.append([f"--- {group}"])
        for method in members:
            one = summaries[method.key]
            rows.append(
                [
                    method.title,
                    *(f"{one['solved'][level]}/{one['cases'][level]}" for level in LEVELS),
                    *(_figure(one["tre_solved_median_mm"][level], ".2f") for level in LEVELS),
                    _figure(one["tre_all_median_mm"], ".2f"),
                    *(_figure(one[name], "d") for name in ("wrong_accepts", "solved_rejects", "reviews")),
                    _figure(one["seconds_median"], ".3f"),
                    _figure(one["seconds_p95"], ".3f"),
                ]
            )
    return _aligned(rows)


def ratios(methods, ratio):
    """One peer a row, one of ours a column: `ratio[peer][ours]`."""
    titles = {method.key: method.title for method in methods}
    ours = list(next(iter(ratio.values())))
    rows = [["our time / theirs", *(key.removeprefix("arthro-") for key in ours)]]
    rows += [[titles[peer], *(_figure(row[key], ".2f") for key in ours)] for peer, row in ratio.items()]
    return _aligned(rows)
