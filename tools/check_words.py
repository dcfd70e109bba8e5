"""Checks the words of docstrings and comments, as far as a program can, and keeps a count that may only fall.

Checks of each docstring: its first word, "where" for "if", inverted openings, and the length of its paragraphs. Of each
comment all but the first word. `pyproject.toml` holds the count of the last change; `--lower` writes a smaller one.
"""

import argparse
import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("src", "tools", "examples", "benchmarks")
MAX_WORDS = 120  # of a paragraph
MAX_REPORTED = 20
_COUNT = re.compile(r"^(max-found = )(\d+)$", re.MULTILINE)
# A docstring begins with a noun or with a verb in the third person; these words are neither.
_FIRST_WORDS = frozenset(
    re.findall(
        r"\w+",
        "also as at because by how if in it its nothing of on only so that there this to what when where whether "
        "which who whom whose why without",
    )
)
_SENTENCE = r"(?:^|(?<=[.:;!?] )|(?<=\n))"
_RULES = (
    ('"where" that opens a condition: write "if"', re.compile(rf"{_SENTENCE}Where\b|[,;:] where (?!it is written)")),
    ('"where" for "if"', re.compile(r"[Rr]aises \w+(?:(?:,| or| and)+ \w+)* where\b")),
    (
        '"where" for "if"',
        re.compile(r"\b(?<!place )(?<!places )(?<!know )(?<!knows )where (?:there|that|they|none|no|nothing|nobody)\b"),
    ),
    (
        "inverted opening",
        re.compile(rf"{_SENTENCE}(?:By|In|Of|On|From|To|At|With|For|Under|Over) (?:which|what|whom|whose)\b"),
    ),
    ("inverted opening", re.compile(rf"{_SENTENCE}(?:What|Whatever|Whoever|Whose|Whom)\b(?![^.\n]*\?)")),
    (
        "clause that stands for a noun",
        re.compile(r"\b(?:by|in|of|on|from|to|at|with|for) (?:what|whom|whoever|whatever)\b"),
    ),
)


@dataclass(frozen=True)
class Finding:
    """One place that breaks one rule."""

    path: Path
    line: int
    rule: str
    text: str


def find_in_file(path: Path) -> list[Finding]:
    """Returns the findings of one Python file, by line."""
    source = path.read_text(encoding="utf-8")
    findings = []
    for line, text, is_docstring in sorted([*_docstrings(source), *_comments(source)]):
        findings += [Finding(path, line, rule, part) for rule, part in _find_in_text(text, is_docstring)]
    return findings


def _find_in_text(text: str, is_docstring: bool) -> Iterator[tuple[str, str]]:
    bare = re.sub(r"`[^`]*`", "`code`", text)
    first = re.match(r"\W*(\w+)", bare)
    if is_docstring and first is not None and first[1].lower() in _FIRST_WORDS:
        yield f'a docstring begins with "{first[1]}"', text.split("\n")[0]
    for number, paragraph in enumerate(re.split(r"\n\s*\n", bare)):
        if ">>>" in paragraph:  # an example
            continue
        if (words := len(paragraph.split())) > MAX_WORDS:
            yield f"a paragraph of {words} words", paragraph[:60]
        flat = re.sub(r"\n(?!\w+: )", " ", re.sub(r"[ \t]+", " ", re.sub(r"\n[ \t]+", "\n", paragraph.strip())))
        for rule, pattern in _RULES:
            for found in pattern.finditer(flat):
                if found.start() == 0 and is_docstring and number == 0:
                    continue  # its first word was told
                yield rule, flat[max(0, found.start() - 20) : found.end() + 50].replace("\n", " ")


def _docstrings(source: str) -> Iterator[tuple[int, str, bool]]:
    """Yields line and text of each string that stands alone as a statement."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value.strip(), True


def _comments(source: str) -> Iterator[tuple[int, str, bool]]:
    """Yields first line and text of each run of comments."""
    block: list[str] = []
    last = start = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            text = token.string.lstrip("#: ")
            if block and token.start[0] == last + 1:
                block.append(text)
            else:
                if block:
                    yield start, "\n".join(block), False
                block, start = [text], token.start[0]
            last = token.start[0]
    if block:
        yield start, "\n".join(block), False


def main(arguments: list[str]) -> int:
    """Returns 0 if the count is the one that pyproject.toml holds, else 1."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path, help="files or folders to list in full, without a verdict")
    parser.add_argument("--lower", action="store_true", help="write a smaller count to pyproject.toml")
    options = parser.parse_args(arguments)
    roots = options.paths or [ROOT / room for room in ROOMS if (ROOT / room).is_dir()]
    files = [file for root in roots for file in (sorted(root.rglob("*.py")) if root.is_dir() else [root])]
    findings = [finding for file in files for finding in find_in_file(file)]
    if options.paths:
        for found in findings:
            print(f"{found.path}:{found.line}: {found.rule}: {found.text}")
        print(f"{len(findings)} places to write in plainer words.")
        return 0
    settings = ROOT / "pyproject.toml"
    text = settings.read_text(encoding="utf-8")
    allowed = int(tomllib.loads(text)["tool"]["frida-words"]["max-found"])
    _report(findings)
    if options.lower and len(findings) < allowed:
        settings.write_text(_COUNT.sub(rf"\g<1>{len(findings)}", text), encoding="utf-8")
        return 0
    if len(findings) > allowed:
        print(f"{len(findings)} places; {allowed} are allowed. List those of a file: tools/check_words.py FILE")
    elif len(findings) < allowed:
        print(f"{len(findings)} places are left of {allowed}. Keep that: tools/check_words.py --lower")
    return 0 if len(findings) == allowed else 1


def _report(findings: list[Finding]) -> None:
    """Prints the files with most findings, at most MAX_REPORTED."""
    counts = Counter(found.path for found in findings)
    for path, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:MAX_REPORTED]:
        print(f"{count:5}  {path.relative_to(ROOT)}")
    print(f"{len(findings)} places of docstrings and comments to write in plainer words.")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
