"""The launch file starts what is there, with parameters that exist. Here it runs without ROS, on fakes."""

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError

FOLDER = Path(__file__).parents[2] / "bmd_rths_nodes"
GIVEN = {
    "config": "my.yaml",
    "scheme": "",
    "motion": "",
    "component": "",
    "table": "",
    "record": "true",
    "namespace": "/rths",
    "output": "",
    "duration": "",
    "lockstep": "false",
    "autostart": "true",
    "exit_when_done": "false",
    "composed": "false",
    "sigterm_timeout": "30",
}
LOOP = {"numerical_substructure", "command_shaper", "table_driver", "shear_estimator", "force_correction"}


@pytest.fixture
def launch_file(monkeypatch):
    """Run the launch file with actions that only keep their arguments."""
    for name in ("launch", "launch.actions", "launch.substitutions"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    for name in ("launch_ros", "launch_ros.actions", "launch_ros.parameter_descriptions", "launch_ros.substitutions"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    sys.modules["launch"].LaunchDescription = list
    sys.modules["launch.actions"].DeclareLaunchArgument = lambda name, **options: SimpleNamespace(name=name, **options)
    sys.modules["launch.actions"].OpaqueFunction = lambda function: SimpleNamespace(name="", function=function)
    sys.modules["launch.actions"].Shutdown = lambda reason: reason
    sys.modules["launch.substitutions"].PathJoinSubstitution = list
    sys.modules["launch_ros.substitutions"].FindPackageShare = lambda package: FOLDER.parent / package
    sys.modules["launch_ros.actions"].Node = lambda **options: SimpleNamespace(**options)
    sys.modules["launch_ros.parameter_descriptions"].ParameterValue = lambda value, value_type: value_type(value)
    return SimpleNamespace(**runpy.run_path(str(FOLDER / "launch" / "rths.launch.py")))


@pytest.fixture
def nodes(launch_file):
    """Return a function that gives the nodes started with some launch arguments, by executable."""
    *_, action = launch_file.generate_launch_description()

    def start(**arguments):
        context = SimpleNamespace(launch_configurations={**GIVEN, **arguments})
        return {node.executable: node for node in action.function(context)}

    return start


def test_arguments(launch_file):
    arguments = {a.name: a for a in launch_file.generate_launch_description() if a.name}
    assert set(arguments) == set(GIVEN)
    assert Path(*arguments["config"].default_value).is_file()
    assert {name: a.default_value for name, a in arguments.items() if name != "config"} == {
        name: value for name, value in GIVEN.items() if name != "config"
    }


def test_every_executable_exists(nodes):
    started = nodes()
    composed = nodes(composed="true")
    assert set(started) == {*LOOP, "recorder"}
    assert set(composed) == {"composed_loop", "recorder"}
    assert started.keys() | composed.keys() == {path.name for path in (FOLDER / "scripts").iterdir()}
    assert {node.package for node in (*started.values(), *composed.values())} == {"bmd_rths_nodes"}


def test_without_arguments_the_file_decides(nodes):
    for node in nodes().values():
        assert node.parameters == ["my.yaml", {"run.record": True, "autostart": True, "exit_when_done": False}]


def configured(overrides):
    """Return the configuration that some parameters make; autostart belongs to no section."""
    return Config().changed(**{name.replace(".", "__"): value for name, value in overrides.items() if "." in name})


def test_arguments_become_parameters(nodes):
    started = nodes(scheme="uc", motion="123", table="simulated", record="false")
    assert set(started) == LOOP
    for node in started.values():
        file, overrides = node.parameters
        assert file == "my.yaml"
        assert overrides["autostart"] is True
        config = configured(overrides)
        assert (config.run.scheme, config.run.record) == ("uc", False)
        assert (config.ground_motion.record, config.table.controller) == ("123", "simulated")


def test_length_folder_and_lockstep_of_a_test(nodes, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    given = {"duration": "3", "output": "bags", "lockstep": "true", "autostart": "false", "exit_when_done": "true"}
    _, overrides = nodes(**given)["recorder"].parameters
    assert (overrides["autostart"], overrides["exit_when_done"]) == (False, True)
    config = configured(overrides)
    assert (config.ground_motion.duration, config.run.lockstep) == (3.0, True)
    assert config.recorder.directory == str(tmp_path / "bags")


def test_namespace_of_every_node(nodes):
    assert {node.namespace for node in nodes().values()} == {"/rths"}
    assert {node.namespace for node in nodes(namespace="rig1").values()} == {"/rig1"}
    with pytest.raises(InputError, match="namespace 'rig 1' is not allowed"):
        nodes(namespace="rig 1")


def test_time_that_is_no_number_is_refused_before_anything_starts(nodes):
    """Launch itself would find out at the end, and then hang."""
    for name in ("sigterm_timeout", "duration"):
        with pytest.raises(ValueError, match=rf"^{name}: 'soon' is not a number of seconds$"):
            nodes(**{name: "soon"})


@pytest.mark.parametrize(
    ("executable", "status", "ends"),
    [
        ("numerical_substructure", 0, "Shutdown"),
        ("numerical_substructure", 1, "RuntimeError"),
        ("numerical_substructure", -9, "RuntimeError"),
        ("table_driver", 1, ""),
        ("table_driver", -9, ""),  # the numerical substructure notices, and tells how the test ended
        ("table_driver", 2, "RuntimeError"),  # it never started, and the others would wait for it
        ("recorder", 2, "RuntimeError"),
        ("composed_loop", -9, "RuntimeError"),
    ],
)
def test_whose_exit_ends_the_others(nodes, executable, status, ends):
    """An error of launch ends the others too, and is its only way to an exit status that is not 0."""
    on_exit = (nodes() | nodes(composed="true"))[executable].on_exit
    event, running, ending = (
        SimpleNamespace(returncode=status),
        *(SimpleNamespace(is_shutdown=s) for s in (False, True)),
    )
    if ends == "RuntimeError":
        with pytest.raises(RuntimeError, match=f"^{executable} ended with status {status}; the test did not finish$"):
            on_exit(event, running)
    else:
        assert on_exit(event, running) == (f"{executable} ended" if ends else None)
    assert on_exit(event, ending) == (f"{executable} ended" if ends else None)  # Ctrl-C is no error of launch
