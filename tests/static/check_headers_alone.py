#!/usr/bin/env python3
"""Checks that every header compiles alone, twice in one unit, with the project's warnings as
errors.

config.hpp and the Eigen core that it includes are precompiled: every header includes them, which is
checked. A header of bridge/ is left out, with a message, if its library is not installed."""

import os
import re
import shlex
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor

from house import Report, arguments, headers, includes


MISSING = re.compile(r"fatal error: '?(?!clothctl/)([^':\n]+)'?(?:: No such file| file not found)")


CONDITIONAL = re.compile(r"^[ \t]*#[ \t]*ifdef\b.*?^[ \t]*#[ \t]*endif\b", re.M | re.S)


def reaches_config(root, name, known):
    """True when the header `name` always includes config.hpp, directly or through another one."""
    if name not in known:
        known[name] = name == "clothctl/config.hpp"
        path = root / "include" / name
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        known[name] = known[name] or any(
            reaches_config(root, target, known)
            for _, _, target in includes(CONDITIONAL.sub("", text))
            if target.startswith("clothctl/"))
    return known[name]


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
    command = [options.compiler, *shlex.split(options.flags), "-I", str(options.root / "include")]
    for directory in filter(None, options.system.split(";")):
        command += ["-isystem", directory]
    scratch = tempfile.TemporaryDirectory()
    first = os.path.join(scratch.name, "first.hpp")
    with open(first, "w", encoding="utf-8") as file:
        file.write('#include "clothctl/config.hpp"\n')
    prepared = subprocess.run(command + ["-x", "c++-header", first, "-o", first + ".gch"],
                              capture_output=True, text=True)
    if prepared.returncode != 0:
        report.add("include/clothctl/config.hpp", 0, "does not compile\n" + prepared.stderr[:2000])
        report.finish("")
    command += ["-include", first, "-fsyntax-only", "-x", "c++", "-"]

    def compile_alone(header):
        unit = f'#include "clothctl/{header.as_posix()}"\n' * 2
        run = subprocess.run(command, input=unit, capture_output=True, text=True)
        return header, run.returncode, run.stderr

    left_out = []
    known = {}
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
            elif not reaches_config(options.root, "clothctl/" + header.as_posix(), known):
                report.add("include/clothctl/" + header.as_posix(), 0, "does not include config.hpp")
    summary = f"{len(chosen) - len(left_out)} headers with {os.path.basename(options.compiler)}"
    report.finish(summary + (", without " + ", ".join(left_out) if left_out else ""))


if __name__ == "__main__":
    main()
