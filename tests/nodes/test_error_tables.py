"""Tables of many runs: what did not come to its end is marked, and no mean is made of it."""

from bmd_rths_nodes.cli.error_tables import result_with_event, show_error_tables

#: What the runs of these tests say of their loop.
ENDINGS = {"limit": "unstable", "limit of stroke": "limit", "failed": "failed", "cut": "no data"}


def result(error, outcome="finished", scheme="uc", motion="one"):
    errors = dict.fromkeys(("substructure", "control_layer", "superstructure"), error)
    stability = ENDINGS.get(outcome, "stable")
    told = {"motion": motion, "scheme": scheme, "outcome": outcome.partition(" ")[0], "rmse_percent": errors}
    return result_with_event({**told, "stability": stability}, f"/records/{motion}.AT2", {})


def test_mean_is_that_of_whole_stable_runs(capsys):
    runs = [result(10.0), result(30.0, motion="two"), result(99.0, "stopped"), result(77.0, "failed")]
    runs += [result(None, "cut"), result(None, "limit", motion="two"), result(None, "limit of stroke", motion="two")]
    show_error_tables(runs, paper=True, assumed=())
    text = capsys.readouterr().out
    assert "20.00, 1 failed, 1 limit, 1 no data, 1 unstable" in text
    for cell in ("99.00, stopped", "77.00, failed", "no data", " unstable ", " limit "):
        assert cell in text


def test_shipped_record_is_that_of_its_event():
    """Its source is no folder of an earthquake, its name is."""
    assert result(1.0, motion="el_centro_1940_ns")["event"] == "El Centro"
    assert result(1.0, motion="other")["event"] is None


def test_event_that_the_paper_does_not_have_is_shown_without_its_numbers(capsys):
    """A resumed campaign.csv may name any."""
    show_error_tables([{**result(5.0), "event": "Atlantis"}], paper=True, assumed=())
    assert "Atlantis" in capsys.readouterr().out


def test_other_compensators_have_columns_behind_those_of_the_paper(capsys):
    runs = [result(5.0, scheme="mpic", motion="el_centro_1940_ns"), result(20.0, motion="el_centro_1940_ns")]
    runs += [result(7.0, scheme="of_somebody_else", motion="el_centro_1940_ns")]
    show_error_tables(runs, paper=True, assumed=())
    text = capsys.readouterr().out
    assert text.index("uc (paper)") < text.index("mpic") < text.index("of_somebody_else")
    assert "mpic (paper)" not in text
    assert " 5.00 " in text
