#!/usr/bin/env python3
"""Measures compile times of the units in this folder: one for each entry of the library.

Prints for every unit: elapsed and processor seconds (medians of a few runs), the compiler's peak
memory, and processor seconds divided by those of a unit that only includes Eigen/Dense. That ratio
hardly depends on the machine and its load. One compiler runs at a time.

    measure.py                                    every unit, c++ -O2
    measure.py planner --compiler clang++         a unit (and the baseline), another compiler
    measure.py --flags=-fsyntax-only              cost of parsing and types, without code
"""

import argparse
import json
import os
import shlex
import statistics
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
BASELINE = "eigen_dense"
# The stems of the files, in the order of the table.
UNITS = [
    BASELINE,
    "horn",
    "position_based",
    "mass_spring",
    "box_qp",
    "row_qp",
    "inverse_kinematics",
    "stable_pd",
    "planner",
    "world",
]


def parse_options():
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    some = f"some of: {' '.join(UNITS)} (default: all)"
    parser.add_argument("units", nargs="*", metavar="UNIT", help=some)
    parser.add_argument("--root", type=Path, default=HERE.parents[1], help="project root")
    parser.add_argument("--compiler", default="c++", help="default: c++")
    parser.add_argument("--flags", default="-O2", help="default: -O2; write --flags=-O3, with =")
    system = "directories of system headers, separated by ; (default: /usr/include/eigen3)"
    parser.add_argument("--system", default="/usr/include/eigen3", help=system)
    parser.add_argument("--runs", type=int, default=3, help="compilations of each (default: 3)")
    parser.add_argument("--json", action="store_true", help="write JSON instead of a table")
    options = parser.parse_args()
    unknown = [unit for unit in options.units if unit not in UNITS]
    if unknown:
        parser.error(f"no such unit: {' '.join(unknown)}")
    if options.runs < 1:
        parser.error("--runs is not positive")
    return options


def command_for(unit, options, output):
    """Returns the compiler's command line for one unit."""
    command = [options.compiler, "-std=c++20", *shlex.split(options.flags)]
    command += ["-I", str(options.root / "include")]
    for directory in filter(None, options.system.split(";")):
        command += ["-isystem", directory]
    return command + ["-c", str(HERE / f"{unit}.cpp"), "-o", output]


def run(command):
    """Runs a command; returns seconds, processor seconds and peak memory (MB)."""
    start = time.perf_counter()
    child = os.spawnvp(os.P_NOWAIT, command[0], command)
    _, status, usage = os.wait4(child, 0)
    seconds = time.perf_counter() - start
    if os.waitstatus_to_exitcode(status) != 0:
        sys.exit("failed: " + shlex.join(command))
    # Linux counts in KiB, macOS in bytes. The driver's children are included: it waits for them.
    megabytes = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e6 / 1024)
    return seconds, usage.ru_utime + usage.ru_stime, megabytes


def measure(unit, options):
    """Compiles a unit `runs` times; returns median seconds and peak memory."""
    with tempfile.TemporaryDirectory() as scratch:
        command = command_for(unit, options, os.path.join(scratch, "unit.o"))
        runs = [run(command) for _ in range(options.runs)]
    return {
        "unit": unit,
        "seconds": statistics.median(seconds for seconds, _, _ in runs),
        "processor_seconds": statistics.median(processor for _, processor, _ in runs),
        "peak_mb": max(megabytes for _, _, megabytes in runs),
    }


def main():
    options = parse_options()
    wanted = options.units or UNITS
    chosen = [unit for unit in UNITS if unit == BASELINE or unit in wanted]
    rows = []
    if not options.json:
        print(f"{'unit':<20} {'seconds':>8} {'cpu s':>8} {'peak MB':>8} {'/ Eigen':>8}")
    for unit in chosen:
        row = measure(unit, options)
        rows.append(row)
        row["ratio"] = row["processor_seconds"] / rows[0]["processor_seconds"]
        if not options.json:
            numbers = f"{row['seconds']:>8.2f} {row['processor_seconds']:>8.2f}"
            numbers += f" {row['peak_mb']:>8.0f}"
            print(f"{unit:<20} {numbers} {row['ratio']:>8.1f}", flush=True)
    if options.json:
        facts = {key: getattr(options, key) for key in ("compiler", "flags", "runs")}
        print(json.dumps({**facts, "units": rows}, indent=2))


if __name__ == "__main__":
    main()
