"""What a page shows is what happens: its commands, its Python and its quoted output, as far as no graph is needed."""

import glob
import re
import shlex
import shutil
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from bmd_rths_core import load_config, predict_test, select_ground_motion
from bmd_rths_nodes.cli.main import main
from bmd_rths_nodes.cli.monitor_web import WATCH
from bmd_rths_nodes.cli.preflight import in_words
from tests.architecture.test_documented_commands import commands_of
from tests.pages import assert_quoted, blocks_of

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted((DOCS / "tutorial").glob("*.md")), *sorted((DOCS / "how-to").glob("*.md"))]

#: Commands that are run here. The others move a table, serve a page, or need a graph or a person; tests elsewhere do.
OFFLINE = {"--version", "analyze", "campaign", "check", "export", "identify", "layouts", "motions"}
OFFLINE |= {"replay", "simulate", "stability"}

#: What makes a command short. Where its output is quoted, only what does not change that is given.
SHORT = {
    "campaign": ("--set", "ground_motion.duration=1"),
    "identify": ("--duration", "20"),
    "simulate": ("--set", "ground_motion.duration=1"),
}
SHORTER = {"stability": ("--no-sensitivity",)}

#: Pages whose code is run by a test of their own.
RUN_ELSEWHERE = {
    "a_rig_of_your_own.md": "tests/nodes/test_tutorial_of_a_rig.py",
    "add_a_compensator.md": "tests/architecture/test_docs.py",
    "add_a_record_format.md": "tests/architecture/test_pages.py",
    "add_a_report_section.md": "tests/architecture/test_docs.py",
    "write_a_node_of_your_own.md": "tests/nodes/test_node_of_your_own.py",
    "write_a_table_controller.md": "tests/nodes/test_table_contract.py",
}

#: Pages whose quoted output cannot be had here; it has a test below.
QUOTED_ELSEWHERE = ("check_the_computer.md", "watch_a_test.md")

A_BAG = re.compile(r"\bbags/[a-z_0-9]+_\d{8}_\d{6}|\bBAG\b")


def without_a_graph(words):
    """Return what comes to the same numbers in process, `simulate` for `run`; None where there is nothing."""
    if {"--ros", "--table", "--namespace"} & set(words):
        return None
    if words[0] != "run":
        return words if words[0] in OFFLINE else None
    kept = [word for word in words[1:] if word not in ("--lockstep", "--composed", "--monitor")]
    return ["simulate", *kept, "--output", "bags"]


def commands_in(text):
    """Return the arguments of each `bmd-rths` in a block of commands."""
    found = [words for _, words in commands_of(f"```sh\n{text}```\n")]
    return [words[1:] for words in found if len(words) > 1 and Path(words[0]).name == "bmd-rths"]


@pytest.fixture
def reader(tmp_path, monkeypatch, capsys):
    """Return a function that does what a block of a page says, in a fresh folder; it returns what was printed."""
    for name in ("config", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "records").mkdir()
    shutil.copy(ROOT / "bmd_rths_core" / "bmd_rths_core" / "data" / "el_centro_1940_ns.csv", tmp_path / "records")
    for name in ("my_rig.yaml", "my_test.yaml"):
        shutil.copy(ROOT / "config" / "simplified_bmd.yaml", tmp_path / name)
    (tmp_path / "records.csv").write_text("records/el_centro_1940_ns.csv\n")
    (tmp_path / "model.yaml").write_text("/**: {ros__parameters: {shear_estimator: {model_error: 0.2}}}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    bag, names = [], {}

    def command(words, quoted):
        arguments = list(without_a_graph(words) or ())
        if not arguments:
            return
        if words[0] == "run" and quoted:
            config = load_config(arguments[1])
            motion = select_ground_motion(config.ground_motion, config.run.time_step)
            print(in_words(config, predict_test(config, motion)), file=sys.stderr)
        if "--figures" in arguments and "--only" not in arguments:
            arguments += ["--only", "response_of_the_floors"]
        if "--report" in arguments and not quoted:  # the first tutorial quotes what that prints
            arguments[arguments.index("--report") :] = []
        arguments += [*SHORTER.get(arguments[0], ()), *(() if quoted else SHORT.get(arguments[0], ()))]
        expanded = [found for word in arguments for found in matches(word)]
        monkeypatch.setattr("sys.argv", ["bmd-rths", *expanded])
        status = main()
        assert status == 0, (expanded, capsys.readouterr().err)

    def matches(word):
        """Return what a shell makes of a word; what an earlier command without a graph would have left is a bag too."""
        return (sorted(glob.glob(word)) or [recorded(10.0)]) if "*" in word else [word]

    def recorded(duration):
        """Return the bag of a test, for pages that begin with one."""
        if not bag:
            length = f"ground_motion.duration={duration}"
            command(["simulate", "config/simplified_bmd.yaml", "--output", "given", "--set", length], quoted=True)
            bag.extend(Path("given").iterdir())
            capsys.readouterr()
        return str(bag[0])

    def read(block):
        text = A_BAG.sub(lambda _: recorded(0.0 if block.quoted else 10.0), block.text)  # 0: the whole motion
        if block.language == "python":
            exec(text, names)
        told = []
        for words in commands_in(text) if block.language == "sh" else ():
            command(words, block.quoted)
            told += capsys.readouterr()[::-1]
        return "".join(told)

    return read


def runnable(page):
    """Tell whether a page has something that is run here."""
    if page.name in RUN_ELSEWHERE:
        return False
    blocks = blocks_of(page)
    commands = [words for block in blocks if block.language == "sh" for words in commands_in(block.text)]
    return any(block.language == "python" for block in blocks) or any(map(without_a_graph, commands))


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if runnable(page)], ids=lambda page: page.name)
def test_page_shows_what_happens(page, reader):
    with mpl.rc_context({"backend": "Agg"}):
        printed = ""
        for block in blocks_of(page):
            if block.language == "" and page.name not in QUOTED_ELSEWHERE:
                assert_quoted(block.text, printed)
            else:
                printed = reader(block)


def test_address_of_the_page():
    (quoted,) = (block.text for block in blocks_of(DOCS / "how-to" / "watch_a_test.md") if block.language == "")
    assert re.fullmatch(rf"{WATCH} http://127\.0\.0\.1:\d+/#\S+", quoted.strip())


def test_reader_of_the_page_is_that_of_the_code():
    (sketch,) = (b.text for b in blocks_of(DOCS / "how-to" / "add_a_record_format.md") if b.language == "python")
    source = (ROOT / "bmd_rths_core/bmd_rths_core/ground_motion/formats/esm.py").read_text(encoding="utf-8")
    lines = [line.strip().removesuffix(" ...") for line in sketch.splitlines() if line.strip()]
    assert len(lines) == 4
    assert [line for line in lines if line not in source] == []


def test_every_page_that_is_run_elsewhere_is():
    for name, test in RUN_ELSEWHERE.items():
        assert name in (ROOT / test).read_text(encoding="utf-8"), name


def test_what_is_quoted_wrong_is_found():
    printed = "RMSE\n┌──────┬─────┐\n│ floor │ 42.82 % │\n└──────┴─────┘\nbag: bags/a_20261128_234507\nthe end\n"
    assert_quoted("│ floor │ 42.82 % │\n│ closure of a step │ 1 ms │\n…\nthe\nend\n", printed)
    assert_quoted("bag: bags/a_20270101_000000\n", printed)
    for wrong in ("floor 42.83 %\n", "the end\n…\nbag: bags/a_20261128_234507\n"):
        with pytest.raises(AssertionError, match="not printed"):
            assert_quoted(wrong, printed)


def test_run_is_simulated():
    words = shlex.split("run a.yaml --lockstep --scheme uc --monitor")
    assert without_a_graph(words) == ["simulate", "a.yaml", "--scheme", "uc", "--output", "bags"]
    assert without_a_graph(["run", "a.yaml", "--table", "udp://127.0.0.1:1"]) is None
    assert without_a_graph(["doctor"]) is None
