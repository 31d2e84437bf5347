#!/usr/bin/env python3
"""Checks that every header compiles alone, twice in one unit, with the project's warnings as
errors.

A header of bridge/ is left out, with a message, if its library is not installed."""

import os
import re
import shlex
import subprocess
from concurrent.futures import ThreadPoolExecutor

from house import Report, arguments, headers


MISSING = re.compile(r"fatal error: '?(?!clothctl/)([^':\n]+)'?(?:: No such file| file not found)")


def main():
    options = arguments(
        __doc__,
        compiler={"default": "c++"},
        flags={"default": "-std=c++20 -Wall -Wextra -Wconversion -Wshadow -Werror"},
        system={"default": "/usr/include/eigen3",
                "help": "directories of system headers, separated by ;"},
        only={"default": "", "help": "check only headers whose name contains this"},
        jobs={"type": int, "default": os.cpu_count() or 1},
    )
    report = Report("headers alone")
    command = [options.compiler, *shlex.split(options.flags), "-fsyntax-only", "-I",
               str(options.root / "include")]
    for directory in filter(None, options.system.split(";")):
        command += ["-isystem", directory]
    command += ["-x", "c++", "-"]

    def compile_alone(header):
        unit = f'#include "clothctl/{header.as_posix()}"\n' * 2
        run = subprocess.run(command, input=unit, capture_output=True, text=True)
        return header, run.returncode, run.stderr

    left_out = []
    chosen = [h for h in headers(options.root) if options.only in h.as_posix()]
    with ThreadPoolExecutor(max(1, options.jobs)) as pool:
        for header, code, errors in pool.map(compile_alone, chosen):
            missing = MISSING.search(errors) if header.parts[0] == "bridge" else None
            if code != 0 and missing:
                left_out.append(f"{header.as_posix()} (needs {missing.group(1)})")
            elif code != 0:
                lines = [line for line in errors.splitlines() if "error" in line][:3]
                report.add("include/clothctl/" + header.as_posix(), 0,
                           "does not compile alone\n    " + "\n    ".join(lines))
    summary = f"{len(chosen) - len(left_out)} headers with {os.path.basename(options.compiler)}"
    report.finish(summary + (", without " + ", ".join(left_out) if left_out else ""))


if __name__ == "__main__":
    main()
