"""Blocks of code of a page, and what it quotes of the output of its commands."""

import re
from dataclasses import dataclass

#: Rows of a table of results that a run in process, which has no deadlines, does not have.
OF_THE_CLOCK = ("missed deadlines", "steps that began late", "closure of a step")


@dataclass(frozen=True)
class Block:
    """A block of code of a page; `quoted` says that the next block shows what it prints."""

    language: str
    text: str
    quoted: bool = False


def blocks_of(page):
    """Return the blocks of code of a page in order."""
    found = re.findall(r"^([ ]*)```(\S*)\n(.*?)^[ ]*```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    following = [*(language for _, language, _ in found[1:]), "-"]
    return [Block(language, text, after == "") for (_, language, text), after in zip(found, following, strict=True)]


def words_on_one_line(text):
    """Return text without the frames of tables, line breaks and what differs from run to run."""
    lines = [line for line in text.splitlines() if not re.fullmatch(r"[\s┌┬┐├┼┤└┴┘─┏┳┓┡╇┩━]*", line)]
    cells = [[cell.strip() for cell in re.split("[│┃]", line) if cell.strip()] for line in lines]
    rows = [" ".join(row) for row in cells if row[0] not in OF_THE_CLOCK]
    return re.sub(r"_\d{8}_\d{6}", "_DATE_TIME", " ".join(" ".join(rows).split()))


def parts_of(quoted):
    """Return what is quoted between the lines that leave something out."""
    return [words_on_one_line(part) for part in re.split(r"^…$", quoted, flags=re.MULTILINE) if part.strip()]


def assert_quoted(quoted, printed):
    """Every part stands in what was printed, in order."""
    left = words_on_one_line(printed)
    for part in parts_of(quoted):
        assert part in left, f"not printed:\n{part}\n\nprinted:\n{left}"
        left = left.partition(part)[2]
