"""What the readers of text formats share: lines, numbers and units, each refused with one clear line."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import STANDARD_GRAVITY

# Fortran and C spellings; narrower than float(), which also takes "nan", "infinity" and "1_000".
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([EeDd][+-]?[0-9]+)?")
# Some files went through two DOS conversions and end their lines in CR CR LF.
_LINE_END = re.compile(r"\r*\n|\r")
_UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01}

#: The units of acceleration that are read, for error messages.
UNITS_READ = "g, m/s², cm/s² or gal"


@dataclass(frozen=True)
class TextFile:
    """A text file and the fingerprint of its bytes.

    Parameters
    ----------
    path : Path
        Where it is.
    lines : list of str
        Its lines without their ends; line number n of an editor is ``lines[n - 1]``.
    sha256 : str
        SHA-256 of the bytes, in hexadecimal.
    """

    path: Path
    lines: list[str]
    sha256: str

    def error(self, line_number: int, problem: str) -> InputError:
        """Return an error that names this file and a line of it.

        Parameters
        ----------
        line_number : int
            As an editor counts, from 1.
        problem : str
            What is wrong there.
        """
        return InputError(f"{self.path}: line {line_number}: {problem}")

    def number(self, line_number: int, text: str) -> float:
        """Return the finite number written as `text`, also with a Fortran D exponent.

        Parameters
        ----------
        line_number : int
            Where it is written, for the message.
        text : str
            The number.

        Raises
        ------
        InputError
            The text is anything else.
        """
        value = float(text.upper().replace("D", "E")) if _NUMBER.fullmatch(text) else math.nan
        if not math.isfinite(value):
            raise self.error(line_number, f"{quoted(text)} is not a finite number")
        return value


def read_text(path: str | Path) -> TextFile:
    """Read a text file, in UTF-8 or Latin-1.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    TextFile
        Its lines and its hash.

    Raises
    ------
    InputError
        The file cannot be read, is empty or holds no text.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # a path no file system takes, as one with a NUL in it
        raise InputError(f"{str(path)!r}: cannot be read: {error}") from error
    if not content.strip():
        raise InputError(f"{path}: the file is empty")
    if b"\0" in content:
        raise InputError(f"{path}: a binary file; text is required")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:  # names of places in old headers; every byte is a character of Latin-1
        text = content.decode("latin-1")
    return TextFile(path, _LINE_END.split(text), hashlib.sha256(content).hexdigest())


def unit_factor(unit: str) -> float | None:
    """Return how many m/s² one `unit` is, or None for text that is no unit of acceleration.

    Parameters
    ----------
    unit : str
        For example ``"G"``, ``"cm/s/s"``, ``"cm/sec**2"``, ``"m/s²"``.
    """
    spelling = unit.strip().lower().replace("sec", "s").replace("**", "").replace("^", "").replace("²", "2")
    return _UNITS.get(spelling.replace("/s/s", "/s2"))


def quoted(text: str) -> str:
    """Return `text` in quotes, on one line and of a length fit for a message.

    Parameters
    ----------
    text : str
        Any text.
    """
    text = text.strip()
    return repr(text if len(text) <= 60 else text[:60] + "...")
