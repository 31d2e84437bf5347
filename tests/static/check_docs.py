#!/usr/bin/env python3
"""Checks that every public name has a doc comment.

Public names are the classes, structs, enums, enumerators, aliases, concepts, variables and
functions of namespace clothctl (not of a namespace that ends in `detail`), and the public members
of its classes. Each declaration must follow a line that starts with `///`, or have `///` on one of
its own lines. Exempt are forward declarations, defaulted and deleted functions, destructors,
friends, using-declarations, explicit instantiations, static_assert, and definitions outside their
class.

The scanner reads declarations, not all of C++: it walks namespaces and classes, and skips bodies
and initialisers.
"""

import re

from house import Report, arguments, headers, read, strip_comments

OPEN, CLOSE = {"(": ")", "[": "]", "{": "}"}, {")", "]", "}"}


def blank_preprocessor(code):
    """Blanks directives with their continuation lines."""
    lines, inside = code.split("\n"), False
    for i, line in enumerate(lines):
        if inside or line.lstrip().startswith("#"):
            inside = line.rstrip().endswith("\\")
            lines[i] = ""
    return "\n".join(lines)


def skip_group(code, i):
    """Returns the position after the bracket group that opens at i."""
    depth = 0
    while i < len(code):
        if code[i] in OPEN:
            depth += 1
        elif code[i] in CLOSE:
            depth -= 1
            if depth == 0:
                return i + 1
        i += 1
    return i


def drop_template_heads(head):
    """Removes leading `template <...>` (with a requires-clause after the last one left in place)."""
    while True:
        match = re.match(r"\s*(?:requires\b[^{}();]*?\b)?template\s*<", head)
        if not match:
            return head
        depth, i = 1, match.end()
        while i < len(head) and depth:
            if head[i] in OPEN:
                i = skip_group(head, i)
                continue
            if head[i] == "<":
                depth += 1
            elif head[i] == ">" and head[i - 1] not in "-=":
                depth -= 1
            i += 1
        head = head[i:]


def flatten(head):
    """Empties bracket groups, so that only text at depth 0 remains."""
    out, i = [], 0
    while i < len(head):
        if head[i] in OPEN:
            out.append(head[i] + OPEN[head[i]])
            i = skip_group(head, i)
        else:
            out.append(head[i])
            i += 1
    return "".join(out)


def opens_requires_expression(head):
    """Returns whether a `{` after `head` begins the body of a requires-expression."""
    text = flatten(head).rstrip()
    match = re.search(r"\brequires\s*(\(\))?$", text)
    if not match:
        return False
    if not match.group(1):
        return True
    before = text[: match.start()].rstrip()
    return bool(re.search(r"(\brequires|=|&&|\|\||!|\(|,|;|\{)$", before)) or before == ""


class Scanner:
    """Walks the declarations of a header.

    `everything` includes private nested classes and namespaces named detail."""

    def __init__(self, shown, text, report, everything=False):
        self.shown, self.report, self.everything = shown, report, everything
        self.raw = text.split("\n")
        self.code = blank_preprocessor(strip_comments(text, keep_strings=False))
        self.found = []

    def line(self, i):
        return self.code.count("\n", 0, i) + 1

    def documented(self, start, end):
        first, last = self.line(start), self.line(end)
        above = self.raw[first - 2].strip() if first >= 2 else ""
        return above.startswith("///") or any("///" in self.raw[k - 1]
                                              for k in range(first, last + 1))

    def require(self, start, end, what):
        self.found.append((self.line(start), what))
        if not self.documented(start, end):
            self.report.add(self.shown, self.line(start), f"{what} has no doc comment")

    def scan(self, i, end, kind, public, owner, in_house):
        """Reads the declarations of code[i:end] in a scope of `kind` ('namespace' or 'class')."""
        code = self.code
        while True:
            while i < end and (code[i].isspace() or code[i] == ";"):
                i += 1
            if i >= end:
                return
            if kind == "class":
                label = re.compile(r"(public|protected|private)\s*:(?!:)").match(code, i)
                if label:
                    public = label.group(1) == "public"
                    i = label.end()
                    continue
            i = self.declaration(i, end, kind, public, owner, in_house)

    def declaration(self, start, end, kind, public, owner, in_house):
        """Reads one declaration; returns the position after it."""
        code, i = self.code, start
        while i < end:
            c = code[i]
            if c == ";":
                self.judge(start, i, None, public, owner, in_house)
                return i + 1
            if c in "([":
                i = skip_group(code, i)
                continue
            if c == "{":
                head = code[start:i]
                if opens_requires_expression(head):
                    i = skip_group(code, i)
                    continue
                core = drop_template_heads(head)
                flat = flatten(core)
                space = re.match(r"\s*()namespace\b\s*([\w:]*)", re.sub(r"\binline\s+", "", core))
                if space or re.match(r'\s*extern\s*""\s*$', core):
                    inner = space.group(2) if space else ""
                    close = skip_group(code, i)
                    parts = inner.split("::")
                    hidden = inner == "" or any(part.endswith("detail") for part in parts)
                    if space and hidden and not self.everything:
                        return close
                    self.scan(i + 1, close - 1, "namespace", True, inner,
                              in_house or "clothctl" in parts)
                    return close
                if re.match(r"\s*(requires\b.*?)?\s*enum\b", flat, re.S):
                    close = skip_group(code, i)
                    self.judge(start, i, "enum", public, owner, in_house)
                    if public and in_house:
                        self.enumerators(i + 1, close - 1)
                    return close
                if self.is_class(flat):
                    close = skip_group(code, i)
                    self.judge(start, i, "class", public, owner, in_house)
                    key = re.search(r"\b(class|struct|union)\b", flat).group(1)
                    attributes = r"(?:\[\]\s*)?(?:alignas\(\)\s*)?"
                    name = re.search(rf"\b(?:class|struct|union)\s+{attributes}(\w+)", flat)
                    inner_public = key != "class"
                    if public or self.everything:
                        self.scan(i + 1, close - 1, "class", inner_public,
                                  name.group(1) if name else "", in_house)
                    return close
                plain = re.sub(r"operator\s*(\(\)|\[\]|[^\s\w(]+)", "operator_", flat)
                is_function = "(" in plain and "=" not in plain.split("(")[0]
                if is_function:
                    tail = plain[plain.rindex(")") + 1 :] if ")" in plain else ""
                    listed = re.search(r"\)[^:]*[^:]:[^:]", plain)
                    if listed and re.search(r"[\w>]\s*$", plain) and "->" not in tail:
                        i = skip_group(code, i)  # a member initialised with braces
                        continue
                    self.judge(start, i, "function", public, owner, in_house)
                    return skip_group(code, i)
                i = skip_group(code, i)  # an initialiser
                continue
            i += 1
        return i

    @staticmethod
    def is_class(flat):
        # `struct X` or `class X : public Y`, perhaps after attributes or a requires-clause; not a
        # function or a variable.
        pattern = r"\s*(requires\b.*?)?\s*(typedef\s+)?\b(class|struct|union)\b(.*)$"
        match = re.match(pattern, flat, re.S)
        if not match or "=" in match.group(4):
            return False
        return "(" not in re.sub(r"alignas\(\)|\w+<[^;]*>", "", match.group(4).split(":")[0])

    def judge(self, start, end, what, public, owner, in_house):
        """If the declaration code[start:end] is a public name, requires its comment."""
        if not public or not in_house:
            return
        head = self.code[start:end]
        core = drop_template_heads(head).strip()
        flat = flatten(core)
        if not core:
            return
        if re.match(r"(static_assert|friend|public|private|protected|namespace)\b", core):
            return
        if core.startswith("CLOTHCTL_INSTANTIATE"):
            return  # explicit instantiation
        if re.match(r"using\s+namespace\b", core):
            return
        if re.match(r"using\b", core) and "=" not in flat:
            return
        if re.match(r"(extern\s+)?template\b", core):
            return  # explicit instantiation
        kinds = r"(class|struct|union|enum(\s+class|\s+struct)?)"
        forward = rf"(requires\b.*\s)?{kinds}\s+[\w:<>, ]+(\s*:\s*[\w:]+)?$"
        if what is None and re.match(forward, core, re.S):
            return  # forward declaration
        if re.search(r"=\s*(default|delete)$", core) or re.match(r"(virtual\s+)?~", core):
            return
        plain = re.sub(r"operator\s*(\(\)|\[\]|[^\s\w(]+)", "operator_", flat)
        plain = re.sub(r"\brequires\s+requires\s*(\(\))?\s*\{\}", "", plain)
        plain = plain.replace("decltype()", "auto")
        name = None
        if "(" in plain:
            before = plain.split("(")[0].rstrip()
            scoped = re.search(r"::\s*~?\w+$", re.sub(r"<[^<>]*>", "", before))
            if "=" not in before and scoped and what == "function":
                qualifier = re.search(r"(\w+)(?:<[^()]*>)?\s*::\s*~?\w+$", before)
                if qualifier and qualifier.group(1) not in ("std", "Eigen"):
                    return  # defined outside its class
            found = re.search(r"([~\w]+)$", re.sub(r"<[^<>]*>$", "", before))
            name = found.group(1) if found and "=" not in before else None
        if name is None:
            kinds = r"\b(?:using|concept|enum\s+class|enum|class|struct|union)\s+(\w+)"
            variable = r"(\w+)\s*(?:\[\]\s*)?(?:\{\}|=.*)?$"
            found = re.search(kinds, core) or re.search(variable, plain, re.S)
            name = found.group(1) if found else core.split("\n")[0][:40]
        self.require(start, end, f"'{owner + '::' if owner and owner != 'clothctl' else ''}{name}'")

    def enumerators(self, i, end):
        code = self.code
        while i < end:
            while i < end and (code[i].isspace() or code[i] == ","):
                i += 1
            if i >= end:
                return
            start = i
            while i < end and code[i] != ",":
                i = skip_group(code, i) if code[i] in OPEN else i + 1
            name = re.match(r"\w+", code[start:i])
            self.require(start, min(i, end - 1), f"enumerator '{name.group(0) if name else '?'}'")


def main():
    options = arguments(__doc__, list={"action": "store_true", "help": "print every public name"})
    report = Report("doc comments")
    names = 0
    for header in headers(options.root):
        scanner = Scanner("include/clothctl/" + header.as_posix(), read(options.root, header),
                          report)
        scanner.scan(0, len(scanner.code), "namespace", True, "", False)
        names += len(scanner.found)
        if options.list:
            for line, what in scanner.found:
                print(f"{scanner.shown}:{line} {what}")
    report.finish(f"{names} public names documented")


if __name__ == "__main__":
    main()
