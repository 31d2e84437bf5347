#!/usr/bin/env python3
"""Compiles one source file with the project's headers, its warnings as errors, and given flags.

With --run, also links and runs it."""

import os
import shlex
import subprocess
import sys
import tempfile

from house import arguments


def main():
    options = arguments(
        __doc__,
        compiler={"default": "c++"},
        unit={"required": True, "help": "source file, relative to tests/static"},
        flags={"default": "", "help": "flags in addition to the project's own"},
        run={"action": "store_true", "help": "link the unit and run it"},
        system={"default": "/usr/include/eigen3",
                "help": "directories of system headers, separated by ;"},
    )
    command = [options.compiler, "-std=c++20", "-Wall", "-Wextra", "-Wconversion", "-Wshadow",
               "-Werror"]
    command += shlex.split(options.flags)
    command += ["-I", str(options.root / "include"), "-I", str(options.root / "tests")]
    for directory in filter(None, options.system.split(";")):
        command += ["-isystem", directory]
    with tempfile.TemporaryDirectory() as scratch:
        output = os.path.join(scratch, "unit")
        command += [str(options.root / "tests" / "static" / options.unit), "-o", output]
        code = subprocess.run(command if options.run else command + ["-c"]).returncode
        if code == 0 and options.run:
            code = subprocess.run([output]).returncode
    compiler, outcome = os.path.basename(options.compiler), "ok" if code == 0 else "FAILED"
    print(f"{options.unit} with {compiler} {options.flags}: {outcome}")
    sys.exit(1 if code else 0)


if __name__ == "__main__":
    main()
