"""Names and numbers from files that were made to do harm: on a terminal, in a table, as an output folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.campaign.results import CampaignResults
from bmd_rths_nodes.cli.options import output_folder, printable

ROW = {
    **{"key": "k", "motion": "=1+1", "event": "@e", "file": "-f", "component": "'=c", "scheme": "uc", "variation": {}},
    **{
        "stable": True,
        "stability": "stable",
        "outcome": "finished",
        "reason": "+r",
        "steps": 3,
        "tracking_delay_ms": 1.0,
        "engine": "x",
    },
    "rmse_percent": {"substructure": -1.5, "control_layer": 2.5, "superstructure": None},
    "rmse_true_percent": {"substructure": 1.0, "control_layer": 2.5, "superstructure": None},
    "rmse_clean_percent": {"substructure": 1.0, "control_layer": 2.0, "superstructure": None},
    "noise_floor_percent": {"substructure": None, "control_layer": 8.5, "superstructure": 9.0},
    "capture": {"substructure": 0.5, "superstructure": None},
    **{"tracking_error_percent": 102.0, "delay_ms": -1.0, "verdict": "red"},
    **{"spectral_radius": 0.99, "peak_command": 3.8, "peak_displacement": None},
    **{"peak_velocity": 0.1, "peak_acceleration": None, "peak_force": 5.0},
    **{"criteria": {"J1": 1.0, "J2": None}, "peak_drifts": [0.01, None]},
}


def test_no_text_of_a_table_is_a_formula(tmp_path: Path) -> None:
    results = CampaignResults(tmp_path)
    results.append([ROW])
    assert results.read("k") == ROW
    results.close()
    assert ",'=1+1,'@e,'-f,''=c,".removeprefix(",") in results.path.read_text()


@pytest.mark.parametrize("change", [(",3,", ",three,"), ("{}", "{"), ("\n", ",more,\n"), (",uc,", "\n")])
def test_damaged_line_of_a_resumed_campaign_is_refused_in_one_line(tmp_path: Path, change: tuple[str, str]) -> None:
    results = CampaignResults(tmp_path)
    results.append([ROW])
    results.close()
    header, line = results.path.read_text().splitlines(keepends=True)
    results.path.write_text(header + line.replace(*change))
    again = CampaignResults(tmp_path)
    with pytest.raises(InputError, match=r"is damaged: .*; another --output is required") as caught:
        again.read("k")
    again.close()
    assert len(str(caught.value).splitlines()) == 1


def test_control_characters_are_shown_as_escapes() -> None:
    assert printable("a\x1b[2Jb\nc\u202e\udc80ü") == "a\\x1b[2Jb\\nc\\u202e\\udc80ü"


def test_name_no_file_system_takes_is_refused(tmp_path: Path) -> None:
    for name in ("x" * 300, "a\0b"):
        with pytest.raises(InputError, match="cannot be written: "), output_folder(tmp_path / name):
            pass
