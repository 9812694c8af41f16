"""Write runs into a file: CSV, MAT, HDF5 or Parquet, by its ending."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bmd_rths_core.errors import InputError
from bmd_rths_core.export.channels import ExportedRun
from bmd_rths_core.export.flat_table import flat_table
from bmd_rths_core.export.text_cells import write_csv

#: Most bytes of a variable of a MAT file of version 7.
_MAT_LIMIT = 2**31 - 1


def to_csv(runs: Sequence[ExportedRun], path: Path) -> None:
    """Write one CSV file: ``run``, ``phase``, then every column with its unit in brackets.

    Parameters
    ----------
    runs : sequence of ExportedRun
        The runs.
    path : Path
        The file.
    """
    table = flat_table(runs)
    header = ["run", "phase", *(f"{name} [{table.units[name]}]" for name in table.columns)]
    columns = [column.tolist() for column in table.columns.values()]
    write_csv(path, header, zip(table.runs, table.phases, *columns, strict=True))


def to_parquet(runs: Sequence[ExportedRun], path: Path) -> None:
    """Write one Parquet file; unit and description stand in the metadata of each column, all else in those of the file.

    Parameters
    ----------
    runs : sequence of ExportedRun
        The runs.
    path : Path
        The file.
    """
    import pyarrow
    from pyarrow import parquet

    table = flat_table(runs)
    fields = [pyarrow.field("run", pyarrow.string()), pyarrow.field("phase", pyarrow.string())]
    arrays = [pyarrow.array(table.runs, pyarrow.string()), pyarrow.array(table.phases, pyarrow.string())]
    for name, column in table.columns.items():
        arrays.append(pyarrow.array(column))
        metadata = {"unit": table.units[name], "description": table.descriptions[name]}
        fields.append(pyarrow.field(name, arrays[-1].type, metadata=metadata))
    about = {"runs": json.dumps([{**run.about(), **story(run)} for run in runs])}
    parquet.write_table(pyarrow.table(arrays, schema=pyarrow.schema(fields, metadata=about)), path)


def to_hdf5(runs: Sequence[ExportedRun], path: Path) -> None:
    """Write an HDF5 file: groups ``test`` and ``way_to_rest`` with a dataset a signal; of several runs, a group a run.

    Parameters
    ----------
    runs : sequence of ExportedRun
        The runs.
    path : Path
        The file. Unit, kind and description are attributes of each dataset; what is known of a run, those of its group.
    """
    import h5py

    with h5py.File(path, "w") as file:
        for name, run in named(runs):
            group = file.create_group(name) if name else file
            group.attrs.update(run.about())
            for part, text in story(run).items():
                group.create_dataset(part, data=text)
            for part, channels in (("test", run.test), ("way_to_rest", run.way_to_rest)):
                for channel in channels:
                    dataset = group.create_dataset(f"{part}/{channel.name}", data=channel.values)
                    dataset.attrs.update(unit=channel.unit, kind=channel.kind, description=channel.description)


def to_mat(runs: Sequence[ExportedRun], path: Path) -> None:
    """Write a MAT file of version 7: structures ``test``, ``way_to_rest``, ``units`` and ``about``.

    Parameters
    ----------
    runs : sequence of ExportedRun
        The runs; several are structures ``run_1``, ``run_2`` and so on.
    path : Path
        The file.

    Raises
    ------
    InputError
        A signal is larger than what the version takes.
    """
    from scipy.io import savemat

    largest = max(channel.values.nbytes for run in runs for channel in (*run.test, *run.way_to_rest))
    if largest > _MAT_LIMIT:
        raise InputError(f"{path}: a signal of {largest} bytes; version 7 takes {_MAT_LIMIT}, version 7.3 more")
    savemat(path, structures(runs), do_compression=True, oned_as="column", long_field_names=True)


def named(runs: Sequence[ExportedRun]) -> list[tuple[str, ExportedRun]]:
    """Return the runs with the names of their groups: "" for the only one."""
    return [("" if len(runs) == 1 else f"run_{i}", run) for i, run in enumerate(runs, 1)]


def structures(runs: Sequence[ExportedRun]) -> dict[str, Any]:
    """Return what stands in a MAT file, as nested mappings of arrays and text.

    Parameters
    ----------
    runs : sequence of ExportedRun
        The runs.
    """
    content: dict[str, Any] = {}
    for name, run in named(runs):
        own = content.setdefault(name, {}) if name else content
        for part, channels in (("test", run.test), ("way_to_rest", run.way_to_rest)):
            own[part] = {channel.name: channel.values for channel in channels}
        own["units"] = {channel.name: channel.unit for channel in run.test}
        own["about"] = {**run.about(), **story(run)}
    return content


def story(run: ExportedRun) -> dict[str, str]:
    """Return configuration and versions of a run as JSON."""
    record = run.record
    return {
        "configuration": json.dumps(record.configuration, default=dict),
        "versions": json.dumps(record.versions, default=dict),
    }
