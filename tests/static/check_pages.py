#!/usr/bin/env python3
"""Checks that README.md, CONTRIBUTING.md and docs/*.md refer to things that exist.

1. Each relative link and picture leads to a file, and its #anchor to a heading of that page.
2. Each `path/name.hpp` (or .cpp, .py, .txt, .md) in backticks names a file of the project: from the
   root, from include/, include/clothctl/, tests/, docs/, examples/ or bench/, or by its last part.
   A part FOLDER, NAME, FILE or PAGE stands for any name.
3. Each word in backticks that is a name of this library by its form (CamelCase, or snake_case with
   an underscore) occurs in include/, examples/, tests/, bench/, scripts/, models/ or a CMake file.
   So does each such word of a ```cpp block; there, a reader's own types start with My or Your, and
   of snake_case only members and qualified names count.

Points 2 and 3 leave out docs/api_changes.md, which may name removed things.
"""

import re

from house import Report, arguments

PAGES = ("README.md", "CONTRIBUTING.md")
CODE = ("include", "examples", "tests", "bench", "scripts", "cmake", "models")
CODE_SUFFIXES = {".hpp", ".cpp", ".inc", ".py", ".txt", ".cmake", ".in", ".urdf", ""}
LINK = re.compile(r"!?\[[^\]]*\]\(\s*<?([^)\s>]+)>?[^)]*\)")
PATH = re.compile(r"(?<![\w./{-])((?:[\w-]+/)*[\w-]+\.(?:hpp|cpp|inc|py|txt|md))\b(?![/}])")
CAMEL = re.compile(r"(?<![\w-])([A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*[A-Z][A-Za-z0-9]*)(?!\w)")
SNAKE = re.compile(r"(?<![\w.-])([a-z][a-z0-9]*(?:_[a-z0-9]+)+)\b(?![\w-]*[./]\w)")
MEMBER = re.compile(r"(?:\.|->|::)([a-z][a-z0-9]*(?:_[a-z0-9]+)+)\b(?!::)")
STAND_IN = re.compile(r"\b(FOLDER|NAME|FILE|PAGE)\b")
OWN = re.compile(r"(My|Your)[A-Z]")
STARTS = ("", "include", "include/clothctl", "tests", "tests/static", "docs", "examples", "bench")


def pages(root):
    yield from (root / page for page in PAGES if (root / page).exists())
    yield from sorted((root / "docs").glob("**/*.md"))


def anchor(heading):
    """Returns the anchor that code hosts give a heading."""
    text = re.sub(r"[^\w\- ]", "", re.sub(r"`", "", heading).strip().lower())
    return text.replace(" ", "-")


def anchors(path):
    found = re.findall(r"^#{1,6}\s+(.*?)\s*#*$", path.read_text(encoding="utf-8"), re.M)
    return {anchor(heading) for heading in found}


def spans(text):
    """Yields (line number, code, whether in a block) of each backticked span and ```cpp line."""
    fence = None
    for number, line in enumerate(text.split("\n"), 1):
        mark = re.match(r"\s*(?:`{3,}|~{3,})\s*(\S*)", line)
        if mark:
            fence = mark.group(1) or "text" if fence is None else None
        elif fence is None:
            for span in re.findall(r"(`+)(.+?)\1(?!`)", line):
                yield number, span[1], False
        elif fence in ("cpp", "c++"):
            yield number, re.sub(r"//.*", "", line), True


def check_links(report, root, page, text):
    count = 0
    fence = re.compile(r"^( *)(`{3,}|~{3,}).*?^\1\2", re.M | re.S)
    plain = fence.sub(lambda match: "\n" * match.group(0).count("\n"), text)
    for number, line in enumerate(plain.split("\n"), 1):
        for target in LINK.findall(re.sub(r"(`+).+?\1", "", line)):
            if re.match(r"[a-z]+:", target):
                continue
            count += 1
            name, _, part = target.partition("#")
            path = (page.parent / name).resolve() if name else page
            if not path.exists():
                report.add(page.relative_to(root), number,
                           f"links to {target}, which does not exist")
            elif part and path.suffix == ".md" and part not in anchors(path):
                report.add(page.relative_to(root), number, f"links to {target}: no such heading")
    return count


def check_names(report, root, page, text, words, files):
    count = 0
    for number, code, block in spans(text):
        shown = page.relative_to(root)
        for name in PATH.findall(code):
            count += 1
            if name not in files and not STAND_IN.search(name):
                report.add(shown, number, f"names `{name}`, which is no file of the project")
        for name in CAMEL.findall(code) + (MEMBER if block else SNAKE).findall(code):
            count += 1
            if name not in words and not (block and OWN.match(name)):
                report.add(shown, number, f"names `{name}`, which occurs nowhere in the code")
    return count


def main():
    options = arguments(__doc__)
    root = options.root
    report = Report("pages")
    words, files = set(), set()
    sources = [p for folder in CODE for p in sorted((root / folder).rglob("*"))]
    sources += [root / "CMakeLists.txt", root / "CMakePresets.json"]
    for path in sources:
        if path.is_file() and (path.suffix in CODE_SUFFIXES or path.name == "CMakePresets.json"):
            words.update(re.findall(r"\w+", path.read_text(encoding="utf-8", errors="replace")))
            words.update((path.stem, path.parts[-2] + "_" + path.stem))
    for path in root.rglob("*"):
        inner = path.relative_to(root)
        if not path.is_file() or inner.parts[0] in ("build", "out", ".git"):
            continue
        for start in STARTS:
            if inner.as_posix().startswith(start):
                files.add(inner.as_posix()[len(start) :].lstrip("/"))
        files.add(inner.name)
    links = names = count = 0
    for page in pages(root):
        count += 1
        text = page.read_text(encoding="utf-8")
        links += check_links(report, root, page, text)
        if page.name != "api_changes.md":
            names += check_names(report, root, page, text, words, files)
    report.finish(f"{count} pages, {links} links and {names} names lead somewhere")


if __name__ == "__main__":
    main()
