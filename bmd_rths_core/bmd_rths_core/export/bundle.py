"""A folder for an archive: one run, sorted as the hybrid simulations of DesignSafe are.

DesignSafe sorts the files of a hybrid simulation by what they are: global model, master simulation coordinator,
simulation and experimental substructure, the output of each of these three, analysis, report.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from bmd_rths_core.errors import InputError
from bmd_rths_core.export.channels import Channel, ExportedRun, numbers_of
from bmd_rths_core.export.text_cells import write_csv

#: Folder of each category, with its name in the archive and what stands in it.
CATEGORIES = {
    "global_model": ("Global Model", "the resolved configuration and the ground motion as it was run"),
    "coordinator": ("Master Simulation Coordinator", "the software that closed the loop, its versions, and the scheme"),
    "simulation_substructure": ("Simulation Substructure", "parameters of what was computed"),
    "experimental_substructure": (
        "Experimental Substructure",
        "parameters of what stood on the table; its sensors",
    ),
    "coordinator_output": ("Coordinator Output", "the recording as it is, and what was commanded and fed back"),
    "simulation_output": ("Simulation Output", "motion and forces of the numerical substructure"),
    "experimental_output": ("Experimental Output", "what was measured in the test, and on the way to rest"),
    "analysis": ("Analysis", "the reference, the results and how they are judged"),
    "report": ("Report", "one web page with every figure"),
}

_SIMULATED = ("numerical_substructure", "nonlinear", "force_correction")
_EXPERIMENTAL = ("specimen", "table", "simulated_table", "servo_hydraulic", "identified_model", "shear_estimator")
_COORDINATING = ("run", "command_shaper", "safety", "mpic")


def write_bundle(run: ExportedRun, bag: Path, results: Mapping[str, Any], page: str, folder: Path) -> list[Path]:
    """Write a run into a folder of its own.

    Parameters
    ----------
    run : ExportedRun
        The run.
    bag : Path
        Its bag, which is copied.
    results : Mapping
        Plain values, the object of ``bmd-rths analyze --json``.
    page : str
        Its report as a web page.
    folder : Path
        Where; new or empty.

    Returns
    -------
    list of Path
        The files, relative to the folder.

    Raises
    ------
    InputError
        The folder is not empty, or cannot be written.
    """
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"--bundle {folder}: not an empty folder; a new or an empty one is required")
        for category in CATEGORIES:
            (folder / category).mkdir(parents=True, exist_ok=True)
        _write_models(run, folder)
        _write_signals(run, folder)
        _copy_bag(bag, folder / "coordinator_output" / "bag")
        _write_json(folder / "analysis" / "results.json", results)
        (folder / "report" / "report.html").write_text(page, encoding="utf-8")
        (folder / "README.md").write_text(_readme(run), encoding="utf-8")
        return _write_lists(folder)
    except OSError as error:
        raise InputError(f"--bundle {folder}: cannot be written: {error.strerror}") from error


def _write_models(run: ExportedRun, folder: Path) -> None:
    """Write configuration, ground motion, substructures, sensors and versions."""
    record, configuration = run.record, json.loads(json.dumps(run.record.configuration, default=dict))
    _write_yaml(folder / "global_model" / "configuration.yaml", configuration)
    _write_json(folder / "global_model" / "ground_motion.json", dict(record.motion))
    _write_json(folder / "coordinator" / "versions.json", dict(record.versions))
    for category, sections in (
        ("coordinator", _COORDINATING),
        ("simulation_substructure", _SIMULATED),
        ("experimental_substructure", _EXPERIMENTAL),
    ):
        own = {section: configuration[section] for section in sections if section in configuration}
        _write_yaml(folder / category / "parameters.yaml", own)
    rows = [(name, *_sensor(channel)) for channel in _of(run.test, "measured") for name, _ in channel.columns()]
    write_csv(folder / "experimental_substructure" / "sensors.csv", ("name", "unit", "description"), rows)
    for section in ("sensors", "rig"):
        if section in configuration:
            _write_yaml(folder / "experimental_substructure" / f"{section}.yaml", {section: configuration[section]})


def _sensor(channel: Channel) -> tuple[str, str]:
    return channel.unit, channel.description


def _write_signals(run: ExportedRun, folder: Path) -> None:
    """Write every channel into the output it belongs to."""
    computed = {channel.name: channel for channel in _of(run.test, "computed")}
    fed_back = [computed.pop(name) for name in ("required_force", "interface_force", "corrected_force")]
    of_the_specimen = [computed.pop(name) for name in ("specimen_story_shears",) if name in computed]
    commanded = _of(run.test, "commanded")
    _write_channels(run.test, commanded[:1], folder / "global_model" / "ground_motion.csv")
    _write_channels(run.test, [*commanded, *fed_back], folder / "coordinator_output" / "commands_and_forces.csv")
    _write_channels(run.test, list(computed.values()), folder / "simulation_output" / "numerical_substructure.csv")
    measured = [*_of(run.test, "measured"), *of_the_specimen]
    _write_channels(run.test, measured, folder / "experimental_output" / "measured.csv")
    rest = [*_of(run.way_to_rest, "commanded"), *_of(run.way_to_rest, "measured")]
    _write_channels(run.way_to_rest, rest, folder / "experimental_output" / "way_to_rest.csv")
    _write_channels(run.test, _of(run.test, "reference"), folder / "analysis" / "reference.csv")


def _of(channels: Sequence[Channel], kind: str) -> list[Channel]:
    return [channel for channel in channels if channel.kind == kind]


def _write_channels(table: Sequence[Channel], channels: Sequence[Channel], path: Path) -> None:
    columns = [*_of(table, "time"), *channels]
    units = {name: channel.unit for channel in columns for name, _ in channel.columns()}
    values = [column.tolist() for column in numbers_of(columns).values()]
    write_csv(path, [f"{name} [{unit}]" for name, unit in units.items()], zip(*values, strict=True))


def _copy_bag(bag: Path, folder: Path) -> None:
    if bag.is_dir():
        shutil.copytree(bag, folder)
    else:
        folder.mkdir()
        shutil.copy2(bag, folder)


def _readme(run: ExportedRun) -> str:
    about = run.about()
    lines = [f"# Real-time hybrid simulation {about['name']}", ""]
    lines += [f"- {key.replace('_', ' ')}: {value}" for key, value in about.items() if key != "name"]
    lines += ["", "SI units. Names and signs are those of the nomenclature of bmd_rths.", ""]
    lines += ["| folder | category | content |", "|---|---|---|"]
    lines += [f"| `{name}` | {category} | {content} |" for name, (category, content) in CATEGORIES.items()]
    if run.left_out:
        lines += ["", "Not in it:", *(f"- {reason}" for reason in run.left_out)]
    lines += ["", "`files.json` has the category of every file, `manifest-sha256.txt` its hash (`sha256sum -c`).", ""]
    return "\n".join(lines)


def _write_lists(folder: Path) -> list[Path]:
    """Write what is in the folder: the category and the hash of every file."""
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    categories = {str(path.as_posix()): CATEGORIES[path.parts[0]][0] for path in files if path.parts[0] in CATEGORIES}
    _write_json(folder / "files.json", {"type": "Hybrid Simulation", "files": categories})
    files = [*files, Path("files.json")]
    hashes = [f"{_sha256(folder / path)}  {path.as_posix()}\n" for path in files]
    (folder / "manifest-sha256.txt").write_text("".join(hashes), encoding="utf-8")
    return [*files, Path("manifest-sha256.txt")]


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False, default=dict) + "\n", encoding="utf-8")


def _write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True), encoding="utf-8")
