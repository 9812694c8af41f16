"""Dockerfile and devcontainer, read as text: what they name is there, and what they do harms nothing."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def instructions(name):
    return re.findall(rf"^{name} (.*)$", DOCKERFILE, flags=re.MULTILINE)


def test_image_has_what_its_requirements_name_and_what_its_command_reads():
    copied = {source for line in instructions("COPY") for source in line.split()[:-1]}
    lines = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    local = {line.removeprefix("./") for line in lines if line.startswith("./")}
    files = {line.split()[1] for line in lines if line.startswith("-c ")}
    assert local | files | {"requirements.txt"} <= copied
    assert all((ROOT / source).exists() for source in copied)
    (command,) = instructions("CMD")
    config = json.loads(command)[1].removeprefix("/opt/bmd_rths/")
    assert config.split("/")[0] in copied
    assert (ROOT / config).is_file()


def test_stop_of_a_container_is_ctrl_c():
    """SIGTERM does nothing to the first process of a container before it asks for it: the test would begin."""
    assert instructions("STOPSIGNAL") == ["SIGINT"]


def test_devcontainer_leaves_the_environment_of_the_host_alone():
    """The workspace is the folder of the host, and so is `.venv` in it."""
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    made = re.search(r"-m venv (\S+) && (\S+)/bin/pip install -r (\S+)$", container["postCreateCommand"])
    assert made[1] == made[2]
    assert made[1].startswith("/opt/")
    assert (ROOT / made[3]).is_file()
    interpreter = container["customizations"]["vscode"]["settings"]["python.defaultInterpreterPath"]
    assert interpreter == f"{made[1]}/bin/python"
    assert container["remoteEnv"]["PATH"].split(":")[0] == f"{made[1]}/bin"
