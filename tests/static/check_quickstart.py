#!/usr/bin/env python3
"""Checks that the README's first program is the one in examples/quickstart.cpp, is under 40 lines, compiles from the README's own
text and runs.

The program is the first ```cpp block of README.md with a `main`."""

import os
import re
import subprocess
import sys
import tempfile

from house import Report, arguments


def main():
    options = arguments(
        __doc__,
        compiler={"default": "c++"},
        system={"default": "/usr/include/eigen3", "help": "directories of system headers, separated by ;"},
    )
    report = Report("quickstart")
    readme = options.root / "README.md"
    source = options.root / "examples" / "quickstart.cpp"
    for path in (readme, source):
        if not path.exists():
            report.add(path.relative_to(options.root), 0, "does not exist")
    if report.findings:
        report.finish("")
    blocks = re.findall(r"^```(?:cpp|c\+\+)\n(.*?)^```", readme.read_text(encoding="utf-8"), re.M | re.S)
    programs = [block for block in blocks if re.search(r"\bint main\s*\(", block)]
    if not programs:
        report.add("README.md", 0, "shows no program with a main")
        report.finish("")
    program = programs[0]
    lines = program.strip().count("\n") + 1
    if lines >= 40:
        report.add("README.md", 0, f"the program has {lines} lines; it must stay under 40")
    if program.strip() != source.read_text(encoding="utf-8").strip():
        report.add("README.md", 0, "the program differs from examples/quickstart.cpp")
    with tempfile.TemporaryDirectory() as scratch:
        unit = os.path.join(scratch, "quickstart.cpp")
        with open(unit, "w", encoding="utf-8") as file:
            file.write(program)
        binary = os.path.join(scratch, "quickstart")
        command = [options.compiler, "-std=c++20", "-O1", "-I", str(options.root / "include")]
        for directory in filter(None, options.system.split(";")):
            command += ["-isystem", directory]
        if subprocess.run(command + [unit, "-o", binary]).returncode != 0:
            report.add("README.md", 0, "the program does not compile")
        else:
            run = subprocess.run([binary], cwd=scratch, capture_output=True, text=True, timeout=300)
            sys.stdout.write(run.stdout)
            if run.returncode != 0:
                report.add("README.md", 0, f"the program ends with code {run.returncode}: {run.stderr.strip()}")
    report.finish(f"{lines} lines, compiled and run from the README")


if __name__ == "__main__":
    main()
