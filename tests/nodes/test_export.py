"""`bmd-rths export`: what pandas, scipy and h5py read from its files is what is in the bag, bit for bit."""

import hashlib
import json
import shutil
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pandas
import pyarrow.parquet
import pytest
import scipy.io

from bmd_rths_core.analysis.metrics import reference_of
from bmd_rths_core.analysis.numerical_motion import numerical_motion
from bmd_rths_core.config import Config
from bmd_rths_core.export.channels import ascii_unit
from bmd_rths_core.export.text_cells import cell
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.rest_record import REST_SIGNALS
from bmd_rths_core.signals import SIGNALS
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record

CONFIG = Config().changed(ground_motion__duration=1.0, ground_motion__free_vibration=0.0)
UNITS = {signal.name: ascii_unit(signal.unit) for signal in SIGNALS}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Record a short test; one accelerometer missed a step."""
    record = RthsLoop(CONFIG, select_ground_motion(CONFIG.ground_motion, CONFIG.run.time_step)).run()
    floors = record.floor_accelerations.copy()
    floors[50, 1] = np.nan
    record = replace(record, floor_accelerations=floors)
    return write_record(record, tmp_path_factory.mktemp("bags") / "short_test")


@pytest.fixture(scope="module")
def record(bag):
    return read_bag(bag)


def exported(run_main, *arguments):
    status, output, errors = run_main("export", *arguments)
    assert status == 0, errors
    return output


def read_csv(file):
    """Read a CSV file with every digit, which pandas does by itself since version 3."""
    return pandas.read_csv(file, **({"float_precision": "round_trip"} if pandas.__version__ < "3" else {}))


def same(found, expected):
    return np.array_equal(np.asarray(found, dtype=float), expected, equal_nan=True)


@pytest.mark.slow
def test_csv_read_with_pandas(run_main, bag, record, tmp_path):
    file = tmp_path / "test.csv"
    assert exported(run_main, bag, "--output", file) == f"{file}\n"
    frame = read_csv(file)
    assert frame["run"].unique().tolist() == ["short_test"]
    test, rest = (frame[frame.phase == phase].reset_index() for phase in ("test", "way_to_rest"))
    assert test["step [1]"].tolist() == list(range(record.steps))
    assert same(test["sensor_time [s]"], record.sensor_time)
    assert same(test["time [s]"], record.time)
    for name, values in record.signals().items():
        columns = [f"{name}_{i + 1}" for i in range(2)] if values.ndim == 2 else [name]
        found = test[[f"{column} [{UNITS[name]}]" for column in columns]]
        assert same(found.to_numpy().reshape(values.shape), values)
    way = record.way_to_rest
    assert rest["step [1]"].tolist() == list(range(record.steps, record.steps + way.steps))
    assert same(rest["command [m/s2]"], way.command)
    assert same(rest["table_displacement [m]"], way.table_displacement)
    assert rest["reference_drifts_1 [m]"].isna().all()


def test_parquet_read_with_pandas_has_units_in_its_schema(run_main, bag, record, tmp_path):
    file = tmp_path / "test.parquet"
    exported(run_main, bag, "--output", file)
    frame = pandas.read_parquet(file)
    test = frame[frame.phase == "test"]
    assert same(test["actuator_force"], record.actuator_force)
    assert same(test[["floor_accelerations_1", "floor_accelerations_2"]], record.floor_accelerations)
    assert test["step"].dtype == np.int64
    schema = pyarrow.parquet.read_schema(file)
    assert {name: schema.field(name).metadata[b"unit"].decode() for name in ("table_displacement", "command")} == {
        "table_displacement": "m",
        "command": "m/s2",
    }
    (about,) = json.loads(schema.metadata[b"runs"])
    assert about["scheme"] == "plc_fc"
    assert json.loads(about["configuration"])["run"]["time_step"] == 0.005


def test_mat_of_version_7_read_with_scipy(run_main, bag, record, tmp_path):
    file = tmp_path / "test.mat"
    exported(run_main, bag, "--output", file)
    found = scipy.io.loadmat(file, simplify_cells=True)
    for name, values in record.signals().items():
        assert same(found["test"][name], values)
    for name in REST_SIGNALS:
        assert same(found["way_to_rest"][name], getattr(record.way_to_rest, name))
    assert found["units"]["table_displacement"] == "m"
    assert found["about"]["motion"] == "el_centro_1940_ns"
    assert found["about"]["time_step"] == 0.005
    assert json.loads(found["about"]["configuration"]) == json.loads(json.dumps(record.configuration))
    columns = scipy.io.loadmat(file)["test"]["command"][0, 0]
    assert columns.shape == (record.steps, 1)


def test_mat_of_version_7_3_has_what_matlab_looks_for(run_main, bag, record, tmp_path):
    """As the files that MATLAB writes itself: head, order of dimensions, classes, text as numbers, what is empty."""
    file = tmp_path / "test.mat"
    exported(run_main, bag, "--output", file, "--mat-version", "7.3")
    head = file.read_bytes()[:512]
    assert head.startswith(b"MATLAB 7.3 MAT-file")
    assert head[124:128] == b"\x00\x02IM"
    with h5py.File(file) as found:
        assert found.userblock_size == 512
        assert found["test"].attrs["MATLAB_class"] == b"struct"
        for name, values in record.signals().items():
            dataset = found["test"][name]
            assert dataset.attrs["MATLAB_class"] == b"double"
            assert dataset.shape == ((1, record.steps) if values.ndim == 1 else values.shape[::-1])
            assert same(dataset[...].T.reshape(values.shape), values)
        assert found["test/step"].attrs["MATLAB_class"] == b"int64"
        unit = found["units/command"]
        assert (unit.attrs["MATLAB_class"], unit.attrs["MATLAB_int_decode"]) == (b"char", 2)
        assert unit[...].ravel().tobytes().decode("utf-16-le") == "m/s2"
        reason = found["about/reason"][...].ravel().tobytes().decode("utf-16-le")
        assert reason == record.reason
        assert same(found["way_to_rest/command"][...].ravel(), record.way_to_rest.command)


def test_what_is_empty_has_its_shape_in_version_7_3(run_main, record, tmp_path):
    bag = write_record(replace(record, way_to_rest=None, reason=""), tmp_path / "bag")
    exported(run_main, bag, "--output", tmp_path / "test.mat", "--mat-version", "7.3")
    with h5py.File(tmp_path / "test.mat") as found:
        for name, shape in (("way_to_rest/command", [0, 1]), ("way_to_rest/floor_accelerations", [0, 2])):
            assert found[name].attrs["MATLAB_empty"] == 1
            assert found[name][...].tolist() == shape
        assert found["about/reason"].attrs["MATLAB_empty"] == 1


def test_hdf5_has_names_units_and_what_they_mean(run_main, bag, record, tmp_path):
    file = tmp_path / "test.h5"
    exported(run_main, bag, "--output", file)
    with h5py.File(file) as found:
        for name, values in record.signals().items():
            dataset = found["test"][name]
            assert same(dataset[...], values)
            assert dataset.attrs["unit"] == UNITS[name]
        assert found["test/table_acceleration"].attrs["kind"] == "measured"
        assert found["test/table_acceleration"].attrs["description"].endswith("at sensor_time")
        for name in REST_SIGNALS:
            assert same(found["way_to_rest"][name][...], getattr(record.way_to_rest, name))
        assert found.attrs["outcome"] == "finished"
        assert json.loads(found["versions"][()])["bmd_rths"] == record.versions["bmd_rths"]


def test_computed_signals_are_those_of_the_report(run_main, bag, record, tmp_path):
    exported(run_main, bag, "--output", tmp_path / "test.h5")
    motion, reference = numerical_motion(record, CONFIG), reference_of(record, CONFIG)
    masses, measured = CONFIG.specimen.masses, record.floor_accelerations
    with h5py.File(tmp_path / "test.h5") as found:
        test = found["test"]
        assert same(test["floor_displacements"][...], motion.displacements)
        assert same(test["story_drifts"][...], motion.drifts)
        assert same(test["story_forces"][...], motion.story_forces)
        assert same(test["reference_accelerations"][...], reference)
        shears = test["specimen_story_shears"][...]
        assert same(shears[:, 1], -masses[1] * measured[:, 1])
        assert np.allclose(shears[:, 0], -masses[0] * measured[:, 0] - masses[1] * measured[:, 1], equal_nan=True)
        # Twice the derivative of what is relative to the ground, with the ground, is what is absolute.
        displacements = test["reference_displacements"][...]
    twice = np.diff(displacements, 2, axis=0) / record.time_step**2 + record.ground_acceleration[1:-1, None]
    assert np.abs(twice - reference[1:-1]).max() < 0.03 * np.abs(reference).max()


@pytest.mark.slow
def test_several_bags_in_one_file(run_main, bag, record, tmp_path):
    other = tmp_path / "=cmd|' calc'!A0"
    shutil.copytree(bag, other)
    exported(run_main, bag, other, bag, "--output", tmp_path / "all.csv")
    frame = pandas.read_csv(tmp_path / "all.csv")
    assert frame["run"].unique().tolist() == ["short_test", f"'{other.name}", "short_test (2)"]
    assert (frame.groupby("run").size() == record.steps + record.way_to_rest.steps).all()
    exported(run_main, bag, other, "--output", tmp_path / "all.mat")
    found = scipy.io.loadmat(tmp_path / "all.mat", simplify_cells=True)
    assert found["run_2"]["about"]["name"] == other.name
    assert same(found["run_2"]["test"]["command"], record.command)


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\tx", "\rx", "'x"])
def test_text_that_a_program_of_tables_runs_is_marked(text):
    assert cell(text) == f"'{text}"


def test_numbers_are_no_text():
    values = [-1.5, 0.1 + 0.2, -3, float("nan"), None, "plain -1"]
    assert [cell(value) for value in values] == ["-1.5", "0.30000000000000004", "-3", "", "", "plain -1"]


@pytest.mark.slow
def test_bundle_has_everything_an_archive_asks_for(run_main, bag, record, tmp_path):
    folder = tmp_path / "archive"
    told = json.loads(exported(run_main, bag, "--bundle", folder, "--json"))
    assert told["bundles"] == [str(folder)]
    listed = json.loads((folder / "files.json").read_text())
    assert listed["type"] == "Hybrid Simulation"
    assert set(listed["files"].values()) == {
        *("Global Model", "Master Simulation Coordinator", "Simulation Substructure", "Experimental Substructure"),
        *("Coordinator Output", "Simulation Output", "Experimental Output", "Analysis", "Report"),
    }
    for line in (folder / "manifest-sha256.txt").read_text().splitlines():
        digest, path = line.split("  ")
        assert hashlib.sha256((folder / path).read_bytes()).hexdigest() == digest
    assert read_bag(folder / "coordinator_output" / "bag").same_signals(record)
    measured = read_csv(folder / "experimental_output" / "measured.csv")
    assert same(measured["table_displacement [m]"], record.table_displacement)
    rest = read_csv(folder / "experimental_output" / "way_to_rest.csv")
    assert same(rest["command [m/s2]"], record.way_to_rest.command)
    sensors = pandas.read_csv(folder / "experimental_substructure" / "sensors.csv")
    assert {"table_displacement", "floor_accelerations_2"} <= set(sensors["name"])
    assert json.loads((folder / "analysis" / "results.json").read_text())["outcome"] == "finished"
    assert (
        "<svg" in (folder / "report" / "report.html").read_text()
        or "image/svg" in (folder / "report" / "report.html").read_text()
    )
    assert json.loads((folder / "coordinator" / "versions.json").read_text()) == dict(record.versions)


@pytest.mark.slow
def test_what_the_record_lacks_is_left_out_and_told(run_main, record, tmp_path):
    gone = np.full(record.steps, np.nan)
    bag = write_record(replace(record, required_force=gone), tmp_path / "bag")
    status, _, errors = run_main("export", bag, "--output", tmp_path / "test.csv")
    assert status == 0
    assert "left out: floor displacements, drifts and story forces: nothing was recorded of the forces" in errors
    assert "story_drifts_1 [m]" not in pandas.read_csv(tmp_path / "test.csv").columns


@pytest.mark.slow
def test_readings_of_calibrated_sensors_stand_beside_their_values(run_main, record, tmp_path):
    calibrated = CONFIG.changed(
        sensors__table_acceleration_scale=-2.0,
        sensors__table_acceleration_offset=0.25,
        sensors__floor_offsets=(0.0, 3.0),
    )
    bag = write_record(replace(record, configuration=calibrated.as_mapping()), tmp_path / "bag")
    exported(run_main, bag, "--output", tmp_path / "test.csv")
    table, unit = read_csv(tmp_path / "test.csv")[: record.steps], "[unit of the reading]"
    values = -2.0 * (table[f"table_acceleration_reading {unit}"] - 0.25)
    assert values.to_numpy() == pytest.approx(record.table_acceleration, rel=1e-12, abs=1e-12, nan_ok=True)
    second = table[f"floor_accelerations_reading_2 {unit}"] - table["floor_accelerations_2 [m/s2]"]
    assert second.dropna().to_numpy() == pytest.approx(3.0, rel=1e-12)
    assert same(table[f"base_shear_reading {unit}"], record.base_shear)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((), "export: nothing to write; --output FILE or --bundle DIR is required"),
        (("--output", "test.xls"), "--output test.xls: unknown ending '.xls'; one of .csv, .mat, .h5, .hdf5, .parquet"),
        (("--output", "nowhere/test.csv"), "--output nowhere/test.csv: a file in a folder that exists is required"),
        (("--output", "test.csv", "--mat-version", "7.3"), "--mat-version 7.3: the file ends with .csv; .mat is"),
        (("--bundle", "full"), "--bundle full: not an empty folder; a new or an empty one is required"),
    ],
)
def test_wrong_use_is_one_line(run_main, bag, tmp_path, arguments, problem):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    status, output, errors = run_main("export", bag, *arguments)
    assert (status, output) == (2, "")
    (line,) = errors.splitlines()
    assert line.startswith(f"error: {problem}")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("test.h5",), "h5py: not installed; a .h5 file requires it (pip install h5py)"),
        (("test.mat", "--mat-version", "7.3"), "h5py: not installed; a .mat file of version 7.3 requires it"),
        (("test.parquet",), "pyarrow: not installed; a .parquet file requires it (pip install pyarrow)"),
    ],
)
def test_missing_library_is_one_line(run_main, bag, monkeypatch, arguments, problem):
    for name in ("h5py", "pyarrow", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, name, None)
    status, _, errors = run_main("export", bag, "--output", *arguments)
    assert status == 2
    assert errors.startswith(f"error: {problem}")


def test_file_that_cannot_be_written_leaves_the_old_one(run_main, bag, monkeypatch, tmp_path):
    file = tmp_path / "test.csv"
    file.write_text("old")

    def full(runs, path):
        path.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bmd_rths_core.export.files.to_csv", full)
    status, _, errors = run_main("export", bag, "--output", file)
    assert (status, errors) == (2, f"error: --output {file}: cannot be written: No space left on device\n")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("test.csv", "old")]


@pytest.mark.slow
def test_export_imports_no_ros(bag, tmp_path):
    code = (
        "import sys; from bmd_rths_nodes.cli.main import main; assert main() == 0; "
        "assert not {'rclpy', 'diagnostic_msgs', 'ament_index_python'} & set(sys.modules)"
    )
    arguments = ("export", bag, "--output", tmp_path / "test.mat", "--bundle", tmp_path / "bundle")
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
