"""What the programs that stress the painter share: their options, and their tables."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from frida_painter_lab.experiment import ResultTable


@dataclass(frozen=True)
class Table:
    """Figures as they are shown: a title, columns, rows of text, and what has to be said about them."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def markdown(self) -> str:
        names = [name or " " * number for number, name in enumerate(self.columns)]
        rows = [dict(zip(names, row, strict=True)) for row in self.rows]
        return ResultTable(self.title, rows, self.notes).markdown()


def arguments(description: str | None) -> argparse.ArgumentParser:
    """What every program understands."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write the figures there")
    parser.add_argument("--quick", action="store_true", help="a tiny run that only shows that everything works")
    return parser


def publish(tables: Sequence[Table], figures: object, options: argparse.Namespace) -> None:
    """Shows the tables, and writes the figures if that was asked for."""
    print("\n".join(table.markdown() for table in tables))
    if options.json:
        options.json.write_text(json.dumps({"figures": figures}, indent=2))
