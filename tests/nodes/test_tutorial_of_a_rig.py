"""The tutorial of a rig of one's own: its commands, as they stand, in a fresh folder."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial" / "a_rig_of_your_own.md"

#: The tutorial ends in less time than this [s].
PATIENCE = 400


def blocks():
    """Return the commands of the page, one text a block."""
    return re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)


def test_the_page_goes_through_every_step():
    text = "\n".join(blocks())
    steps = ("new-rig", "check", "stability", "identify", "simulate", "run", "emulate", "analyze", "export")
    assert [step for step in steps if f"bmd-rths {step} " not in text] == []
    for option in ("--table-frf", "--rate 500", "--shear load_cell", "--lockstep", "--composed", "udp://", "--report"):
        assert option in text, option


@pytest.mark.slow
@pytest.mark.alone
def test_its_commands_run_as_they_stand(tmp_path, monkeypatch):
    """One script, in which the first command that fails ends it; the file is never edited."""
    program = tmp_path / "bin" / "bmd-rths"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m bmd_rths_nodes.cli.main "$@"\n')
    program.chmod(0o755)
    folder = tmp_path / "work"
    (folder / "docs" / "tutorial").mkdir(parents=True)
    shutil.copy(TUTORIAL.with_name("table_response.csv"), folder / "docs" / "tutorial")
    environment = {**os.environ, "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}
    script = "set -eux\n" + "\n".join(blocks())
    done = subprocess.run(
        ["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-6000:]
    assert (folder / "report.html").stat().st_size > 100_000
    assert (folder / "signals.csv").stat().st_size > 100_000
    bags = sorted(entry.name for entry in (folder / "bags").iterdir())
    assert len(bags) == 4, bags
