#!/usr/bin/env python3
"""Checks that every concept of include/clothctl/concepts/ is used, documented and tested.

For each concept NAME in concepts/HEADER.hpp (namespaces named detail left out):

1. It constrains a public template: NAME, or a concept of another folder that names it, stands in a
   template head or a requires-clause of a door outside concepts/ (a header that lies in its folder,
   not in detail/).
2. It goes through a trait: the concept's body, or that of a detail concept which it names, uses a
   struct *_traits that the same header declares, and neither names a type of the checked type
   itself (Model::Scalar) nor calls its members (model.step(...)).
3. Its doc comment holds `/// Optional hooks: none.` or `/// Optional hooks: ...` with each hook in
   backticks; a hook so named occurs in the code of include/. A static function of the trait that
   no concept of the header asks for is such a hook and must be named by one of them.
4. An archetype: tests/archetypes/*.cpp states NAME<SomethingArchetype...>, where the type's name
   ends in Archetype. An archetype of a refinement does not count: it can do more.
5. A law suite: a header tests/laws/*_laws.hpp names NAME, or a refinement of it, in its code, and
   a test outside tests/laws/ or of the same name includes that header.
6. A foreign type: tests/concepts/HEADER.cpp specialises the trait for a type of another namespace
   (other_engine::Type) and states NAME<Type...>, or a refinement of it.
"""

import re

from check_docs import OPEN, blank_preprocessor, skip_group
from house import Report, arguments, headers, includes, read, strip_comments

TRAIT = re.compile(r"\bstruct\s+(\w+_traits)\b(?!\s*<)")
# Before a name: excludes its negation and other namespaces.
POSITIVE = r"(?<![!\w:])(?:clothctl::)?"
IDENTIFIER = re.compile(r"`(\w+)[^`]*`")


def code_of(text):
    """Returns the text without comments, strings and preprocessor lines."""
    return blank_preprocessor(strip_comments(text, keep_strings=False))


def without_detail(code):
    """Blanks the bodies of namespaces whose name ends in detail."""
    for match in reversed(list(re.finditer(r"\bnamespace\s+(?:\w+::)*\w*detail\s*\{", code))):
        end = skip_group(code, match.end() - 1)
        body = code[match.end() : end - 1]
        code = code[: match.end()] + "\n" * body.count("\n") + code[end - 1 :]
    return code


def angle_group(code, i):
    """Returns the position after the <...> that opens at i."""
    depth = 0
    while i < len(code):
        if code[i] in OPEN:
            i = skip_group(code, i)
            continue
        if code[i] == "<":
            depth += 1
        elif code[i] == ">" and code[i - 1] not in "-=":
            depth -= 1
            if depth == 0:
                return i + 1
        i += 1
    return i


def constraints(code):
    """Returns the text of all template heads, requires-clauses and constrained autos."""
    parts = []
    for match in re.finditer(r"\btemplate\s*(?=<)", code):
        parts.append(code[match.end() : angle_group(code, match.end())])
    for match in re.finditer(r"\brequires\b(?!\s*[{(])", code):
        end = re.compile(r"[{;]").search(code, match.end())
        parts.append(code[match.end() : end.start() if end else len(code)])
    for match in re.finditer(r"\b[\w:]+\s*(<[^<>;{}]*>)?\s*auto\b", code):
        parts.append(match.group(0))
    return "\n".join(parts)


class Concept:
    """A concept as its header declares it."""

    def __init__(self, text, code, match):
        self.name = match.group(1)
        self.line = code.count("\n", 0, match.start()) + 1
        start = code.rindex("template", 0, match.start())
        self.head = code[start : match.start()]
        found = re.search(r"<\s*(?:class|typename|[\w:]+)\s+(\w+)", self.head)
        self.parameter = found.group(1) if found else ""
        end = match.end()
        while end < len(code) and code[end] != ";":
            end = skip_group(code, end) if code[end] in OPEN else end + 1
        self.body = code[match.end() : end]
        lines = text.split("\n")
        first = code.count("\n", 0, start)
        comment = []
        while first > 0 and lines[first - 1].strip().startswith("///"):
            first -= 1
            comment.insert(0, lines[first].strip()[3:].strip())
        self.comment = "\n".join(comment)

    def hooks(self):
        """The text after `Optional hooks:` up to an empty comment line, or None."""
        match = re.search(r"^Optional hooks:\s*(.*?)(?=\n\s*\n|\Z)", self.comment, re.M | re.S)
        return match.group(1).strip() if match else None

    def names(self, other):
        return bool(re.search(rf"\b{other}\b", self.body))


def concepts_of(text):
    """Returns ({name: Concept}, names of the public ones) of a header."""
    code = code_of(text)
    assert code.count("\n") == text.count("\n")
    declared = re.compile(r"\bconcept\s+(\w+)\s*=")
    every = {m.group(1): Concept(text, code, m) for m in declared.finditer(code)}
    public = {m.group(1) for m in declared.finditer(without_detail(code))}
    return every, public


def closure(concept, every):
    """Returns the concept and all concepts of its header that it is built from."""
    todo, seen = [concept], {}
    while todo:
        item = todo.pop()
        if item.name in seen:
            continue
        seen[item.name] = item
        todo += [other for other in every.values() if other is not item and item.names(other.name)]
    return list(seen.values())


def own_members(concept):
    """Returns the members of the checked type that the concept uses without the trait."""
    found = set()
    if concept.parameter:
        for match in re.finditer(rf"\btypename\s+{concept.parameter}::(\w+)", concept.body):
            found.add(f"{concept.parameter}::{match.group(1)}")
        variables = re.findall(rf"\b{concept.parameter}\s*&{{0,2}}\s*(\w+)\s*[,)]", concept.body)
        for variable in variables:
            for match in re.finditer(rf"\b{variable}\s*(?:\.|->)\s*(\w+)", concept.body):
                found.add(f"{variable}.{match.group(1)}")
    return sorted(found)


def trait_members(code, trait):
    """Returns the static functions of the primary template of a trait."""
    match = re.search(rf"\bstruct\s+{trait}\b(?!\s*<)[^{{;]*\{{", code)
    if not match:
        return set()
    body = code[match.end() : skip_group(code, match.end() - 1)]
    returned = r"(?:constexpr\s+)?[\w:<>&*\s]*?(?:\(\s*auto\s*\)\s*)?"
    return set(re.findall(rf"\bstatic\s+{returned}\b(\w+)\s*\(", body)) - {"decltype"}


class Tests:
    """What the tests contain about concepts."""

    def __init__(self, root):
        self.root = root / "tests"
        self.archetypes = [code_of(self.text(p)) for p in self.files("archetypes/*.[ch]pp")]
        self.laws = {p.name: code_of(self.text(p)) for p in self.files("laws/*_laws.hpp")}
        self.run = set()
        for path in self.files("**/*.cpp"):
            for _, _, target in includes(self.text(path)):
                mine = path.parent.name == "laws" and path.stem != target.split("/")[-1][:-4]
                if target.startswith("laws/") and not mine:
                    self.run.add(target.split("/")[-1])

    def files(self, pattern):
        return sorted(self.root.glob(pattern))

    @staticmethod
    def text(path):
        return path.read_text(encoding="utf-8")

    def archetype(self, name):
        for code in self.archetypes:
            # The concept itself, or a bool constant of the file that is made of it.
            spoken = [name]
            for match in re.finditer(r"\bconstexpr\s+bool\s+(\w+)\s*=([^;]*);", code):
                if re.search(rf"\b{name}\s*<", match.group(2)):
                    spoken.append(match.group(1))
            if any(re.search(rf"{POSITIVE}{word}\s*<\s*[\w:]*Archetype\b", code)
                   for word in spoken):
                return True
        return False

    def law_suites(self, names):
        said = re.compile(r"\b(" + "|".join(names) + r")\b")
        return [name for name, code in self.laws.items() if said.search(code)]

    def foreign(self, traits, names):
        """Returns what is missing, or None."""
        special = rf"\bstruct\s+(?:clothctl::)?(?:{'|'.join(traits)})\s*<\s*(?:\w+::)+(\w+)"
        seen = set()
        for path in self.files("concepts/*.cpp"):
            text = self.text(path)
            code = code_of(text)
            for _, _, target in includes(text):  # types defined in an example
                if target.startswith("../../examples/"):
                    code += code_of(self.text(path.parent / target))
            types = set(re.findall(special, code))
            seen |= types
            stated = rf"{POSITIVE}(?:{'|'.join(names)})\s*<\s*(?:\w+::)*(?:{'|'.join(types)})\b"
            if types and re.search(stated, code):
                return None
        if not seen:
            return f"tests/concepts/ specialises {' or '.join(traits)} for no foreign type"
        return f"tests/concepts/ states {names[0]} of no foreign type ({', '.join(sorted(seen))})"


def check_trait(report, shown, concept, every, code):
    """Point 2; returns the traits that the concept goes through."""
    parts = closure(concept, every)
    declared = set(TRAIT.findall(code))
    used = sorted(t for t in declared if any(part.names(t) for part in parts))
    if not used:
        there = ", ".join(sorted(declared)) or "none"
        report.add(shown, concept.line,
                   f"{concept.name} goes through no trait of its header ({there})")
    own = sorted({member for part in parts for member in own_members(part)})
    if own:
        message = f"{concept.name} asks the type itself, past its trait, for {', '.join(own)}"
        report.add(shown, concept.line, message)
    return used


def check_hooks(report, shown, public, every, code, library):
    """Point 3."""
    named = set()
    for concept in public:
        hooks = concept.hooks()
        if hooks is None:
            lines = "`Optional hooks: ...` or `Optional hooks: none.`"
            message = f"{concept.name}: its doc comment has no line {lines}"
            report.add(shown, concept.line, message)
            continue
        if hooks.rstrip(".").lower() == "none":
            continue
        mine = IDENTIFIER.findall(hooks)
        if not mine:
            message = f"{concept.name}: `Optional hooks:` names no hook in backticks, nor none"
            report.add(shown, concept.line, message)
        for hook in mine:
            named.add(hook)
            if not re.search(rf"\b{hook}\b", library):
                message = f"{concept.name}: the optional hook `{hook}` occurs nowhere in the code"
                report.add(shown, concept.line, message)
    required = "\n".join(concept.body for concept in every.values())
    for trait in sorted(set(TRAIT.findall(code))):
        for member in sorted(trait_members(code, trait)):
            if member not in named and not re.search(rf"\b{member}\b", required):
                message = f"{trait}::{member} is asked for by no concept"
                message += ", and named by none as an optional hook"
                report.add(shown, 0, message)


def main():
    options = arguments(__doc__)
    report = Report("concepts")
    tests = Tests(options.root)
    everywhere = headers(options.root)
    doors = [h for h in everywhere if len(h.parts) == 2 and h.parts[0] != "concepts"]
    used_in = {h: constraints(without_detail(code_of(read(options.root, h)))) for h in doors}
    shorthands = {}
    for header in doors:
        for shorthand in concepts_of(read(options.root, header))[0].values():
            shorthands[shorthand.name] = shorthand
    library = "\n".join(code_of(read(options.root, h)) for h in everywhere)
    count = 0
    for header in (h for h in everywhere if h.parts[0] == "concepts" and len(h.parts) > 1):
        shown = "include/clothctl/" + header.as_posix()
        text = read(options.root, header)
        code = code_of(text)
        every, names = concepts_of(text)
        public = [concept for concept in every.values() if concept.name in names]
        check_hooks(report, shown, public, every, code, library)
        for concept in public:
            count += 1
            spoken = [concept.name] + [s.name for s in shorthands.values() if s.names(concept.name)]
            said = re.compile(rf"\b(?:{'|'.join(spoken)})\b")
            if not any(said.search(found) for found in used_in.values()):
                message = f"{concept.name} constrains no public template outside concepts/"
                report.add(shown, concept.line, message)
            traits = check_trait(report, shown, concept, every, code)
            refined = [concept.name] + [c.name for c in public if c is not concept
                                        and c.names(concept.name)]
            if not tests.archetype(concept.name):
                message = f"{concept.name} has no archetype"
                message += f": tests/archetypes/ states {concept.name}<...Archetype> nowhere"
                report.add(shown, concept.line, message)
            suites = tests.law_suites(refined)
            if not suites:
                report.add(shown, concept.line,
                           f"{concept.name} has no law suite: no tests/laws/*_laws.hpp names it")
            elif not any(suite in tests.run for suite in suites):
                report.add(shown, concept.line,
                           f"{concept.name}: no test includes its law suite {', '.join(suites)}")
            missing = tests.foreign(traits, refined) if traits else None
            if missing:
                report.add(shown, concept.line,
                           f"{concept.name} has no foreign-type test: {missing}")
    report.finish(f"{count} concepts, each with a constrained template, a trait, an archetype, a "
                  "law suite and a foreign type")


if __name__ == "__main__":
    main()
