#!/usr/bin/env python3
"""Checks that all C++ files are formatted by clang-format 14.

Exits with 77 (skipped) if that version is not installed, since other versions format differently.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from house import Report, arguments

VERSION = 14


def formatter():
    for name in (f"clang-format-{VERSION}", "clang-format"):
        program = shutil.which(name)
        if program:
            text = subprocess.run([program, "--version"], capture_output=True, text=True).stdout
            match = re.search(r"version (\d+)", text)
            if match and int(match.group(1)) == VERSION:
                return program
    return None


def main():
    options = arguments(__doc__)
    report = Report("formatting")
    program = formatter()
    if program is None:
        print(f"formatting: skipped, clang-format {VERSION} is not installed")
        sys.exit(77)
    files = []
    for folder in ("include", "tests", "examples", "bench"):
        files += sorted(p for p in (options.root / folder).rglob("*.[ch]pp"))
    # Copies are formatted in place, all by one process. (Not --dry-run, which objects to its own end
    # comments of inline namespaces.)
    with tempfile.TemporaryDirectory() as scratch:
        copies = [Path(scratch) / path.relative_to(options.root) for path in files]
        shutil.copy(options.root / ".clang-format", scratch)
        for path, copy in zip(files, copies):
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, copy)
        subprocess.run([program, "-i", *map(str, copies)], check=True)
        for path, copy in zip(files, copies):
            formatted = copy.read_text(encoding="utf-8").splitlines()
            lines = path.read_text(encoding="utf-8").splitlines()
            if formatted != lines:
                pairs = enumerate(zip(formatted, lines))
                first = next((i for i, (a, b) in pairs if a != b), min(len(formatted), len(lines)))
                report.add(path.relative_to(options.root), first + 1,
                           "is not formatted; run scripts/format")
    report.finish(f"{len(files)} files")


if __name__ == "__main__":
    main()
