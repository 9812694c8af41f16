"""The tutorial of a rig of one's own: its commands, as they stand, in a fresh folder."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.conftest import WITHOUT_LIMITS
from tests.pages import assert_quoted, blocks_of

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial" / "a_rig_of_your_own.md"

#: The tutorial ends in less time than this [s].
PATIENCE = 400

#: Limits that a busy machine does not pass by being late; a shear that comes late makes the command jump. In lockstep
#: nothing is late, and pre-flight and limits are those of the page.
PATIENT = {
    "run__longest_miss_time": 20.0,
    "safety__stale_shear_time": 20.0,
    "safety__stale_controller_time": 20.0,
    **WITHOUT_LIMITS,
}


def blocks(language="sh"):
    """Return the commands of the page, one text a block, or what it quotes of their output."""
    return [block.text for block in blocks_of(TUTORIAL) if block.language == language]


def test_the_page_goes_through_every_step():
    text = "\n".join(blocks())
    steps = ("new-rig", "check", "stability", "identify", "simulate", "run", "emulate", "analyze", "export")
    assert [step for step in steps if f"bmd-rths {step} " not in text] == []
    for option in ("--table-frf", "--rate 500", "--shear load_cell", "--lockstep", "--composed", "udp://", "--report"):
        assert option in text, option


@pytest.mark.long
@pytest.mark.slow
def test_its_commands_run_as_they_stand(tmp_path, monkeypatch):
    """One script, in which the first command that fails ends it; the file is never edited."""
    program = tmp_path / "bin" / "bmd-rths"
    program.parent.mkdir()
    # How late a busy machine is says nothing about the page: `run` in real time is patient here.
    patience = " ".join(f"--set {name.replace('__', '.')}={value}" for name, value in PATIENT.items())
    program.write_text(
        f'#!/bin/sh\ncase "$*" in *--lockstep*) ;; run*) set -- "$@" {patience};; esac\n'
        f'exec {sys.executable} -m bmd_rths_nodes.cli.main "$@"\n'
    )
    program.chmod(0o755)
    folder = tmp_path / "work"
    (folder / "docs" / "tutorial").mkdir(parents=True)
    shutil.copy(TUTORIAL.with_name("table_response.csv"), folder / "docs" / "tutorial")
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "COLUMNS": "200"}  # nothing is broken in two
    script = "set -eux\n" + "\n".join(blocks())
    told = tmp_path / "told.txt"
    with told.open("w") as output:
        done = subprocess.Popen(
            ["bash", "-c", script], cwd=folder, env=environment, stdout=output, stderr=output, start_new_session=True
        )
    try:
        status = done.wait(PATIENCE)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(done.pid, signal.SIGKILL)  # the emulator too, where the script did not come to its end
        done.wait()
    assert status == 0, told.read_text()[-8000:]
    assert_quoted("\n…\n".join(blocks("")), told.read_text())
    assert (folder / "report.html").stat().st_size > 100_000
    assert (folder / "signals.csv").stat().st_size > 100_000
    bags = sorted(entry.name for entry in (folder / "bags").iterdir())
    assert len(bags) == 4, bags
