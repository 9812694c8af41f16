"""Reader of zip archives of records (CESMD) and of workbooks, which are zip archives too."""

from __future__ import annotations

import importlib
import io
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import MAX_BYTES, RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat

#: Most files of an archive that are looked at.
MAX_FILES = 2000

_WORKBOOK = "xl/workbook.xml"


def archive_format(format_of: Callable[[RecordFile], RecordFormat]) -> RecordFormat:
    """Return the format of archives.

    Parameters
    ----------
    format_of : callable
        Finds the format of a file inside, which may be an archive itself; raises `InputError`.

    Returns
    -------
    RecordFormat
        Components are named by their file and their name in it: ``"CHAN001.V2 90 DEG"``.
    """

    def channels(file: RecordFile) -> list[Channel]:
        found: list[Channel] = []
        problems: list[str] = []
        for inside in _members(file):
            try:
                known = format_of(inside)
                part = known.channels(inside)
            except InputError as error:
                if inside.path.suffix.lower() not in (".txt", ".pdf", ".csv", ".xml", ".json", ".md", ""):
                    problems.append(str(error))
                continue
            name = inside.path.name.rpartition("!")[2]
            found += [replace(channel, component=f"{name} {channel.component}".strip()) for channel in part]
        if problems and not found:
            raise InputError(problems[0])
        if not found:
            raise InputError(f"{file.path}: an archive without a ground motion that is read")
        note = f"{len(problems)} files inside are not read, the first: {problems[0]}" if problems else ""
        return [replace(channel, note=channel.note or note) for channel in found]

    return RecordFormat("zip", (".zip",), _recognises, channels)


def _recognises(file: RecordFile) -> bool:
    return file.content.startswith(b"PK\x03\x04")


def _members(file: RecordFile) -> list[RecordFile]:
    """Return the files inside, none of them larger than a record."""
    if str(file.path).count("!") > 1:
        raise InputError(f"{file.path}: an archive in an archive in an archive")
    try:
        with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            if any(entry.filename == _WORKBOOK for entry in entries):
                return [_sheet(file)]
            if len(entries) > MAX_FILES or sum(entry.file_size for entry in entries) > MAX_BYTES:
                raise InputError(f"{file.path}: more than {MAX_FILES} files or {MAX_BYTES // 1_000_000} MB inside")
            members = []
            for entry in entries:
                with archive.open(entry) as stream:
                    content = stream.read(MAX_BYTES + 1)
                if content.strip() and len(content) <= MAX_BYTES:
                    path = Path(f"{file.path}!{Path(entry.filename).name}")
                    members.append(RecordFile(path, content, file.stated))
            return members
    # What zipfile raises: a bad directory, bad data, a method it does not know, a password, an offset outside the file,
    # an early end, and a name or date that is none.
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, OSError, EOFError, ValueError) as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file.path}: a damaged archive: {problem}") from error


def _sheet(file: RecordFile) -> RecordFile:
    """Return the first sheet of a workbook as comma-separated text."""
    try:
        openpyxl = importlib.import_module("openpyxl")
    except ModuleNotFoundError:
        raise InputError(
            f"{file.path}: a workbook; openpyxl is required to read it: pip install bmd_rths_core[xlsx]"
        ) from None
    try:
        book = openpyxl.load_workbook(io.BytesIO(file.content), read_only=True, data_only=True)
        rows = list(book.worksheets[0].iter_rows(values_only=True))
    except Exception as error:  # of a damaged file openpyxl raises what it happens to run into
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file.path}: a damaged workbook: {problem[:200]}") from error
    lines = [",".join("" if cell is None else str(cell) for cell in row) for row in rows]
    return RecordFile(Path(f"{file.path}!sheet.csv"), ("\n".join(lines) + "\n").encode(), file.stated)
