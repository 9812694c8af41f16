"""Every command of a page exists, with the options, parameters, nodes and launch arguments that the page gives it."""

import re
import shlex
from itertools import pairwise
from pathlib import Path

import click
import pytest

from bmd_rths_core.config import Config, load_config
from bmd_rths_nodes.cli.configuration import parsed_settings
from bmd_rths_nodes.cli.main import COMMANDS, cli

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "benchmarks" / "README.md"]

#: What a command of a page may stand in for a person's own words.
_PLACEHOLDER = re.compile(r"…|\.\.\.|\b[A-Z]{3,}\b|\[|<")


def commands_of(text):
    """Return the command lines of the blocks of code and of the code in the text, as (line, words)."""
    blocks = re.findall(r"^[ ]*```(?:sh|bash|console)?\n(.*?)^[ ]*```", text, flags=re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += [
        line.strip() for line in re.findall(r"^    (?=bmd-rths |python benchmarks)(.*)$", text, flags=re.MULTILINE)
    ]
    lines += re.findall(
        r"`((?:bmd-rths|ros2 run|ros2 launch|python benchmarks/)[^`]*)`",
        re.sub(r"```.*?```", "", text, flags=re.DOTALL),
    )
    found = []
    for line in lines:
        for part in re.split(r"&&|;|\||(?<!\S)&(?!\S)", line.partition(" #")[0]):
            try:
                words = shlex.split(part.partition(" > ")[0])
            except ValueError:  # an apostrophe in prose
                continue
            while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
                words = words[1:]
            if words:
                found.append((line.strip(), words))
    return found


def of_program(*begin):
    found = []
    for page in PAGES:
        for line, words in commands_of(page.read_text(encoding="utf-8")):
            if tuple(words[: len(begin)]) == begin:
                found.append(pytest.param(words[len(begin) :], id=f"{page.name}: {line[:80]}"))
    return found


def unknown_option(command, words):
    """Return the option a command does not have, or its value that is not allowed; None when there is none."""
    known = {name: option for option in command.params if isinstance(option, click.Option) for name in option.opts}
    known |= {
        name: option for option in command.params if isinstance(option, click.Option) for name in option.secondary_opts
    }
    names = set(known) | {"--help", "-h"}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if not word.startswith("-") or word == "-":
            continue
        name, _, value = word.partition("=")
        if name not in names:
            return word
        option = known.get(name)
        if option is not None and not option.is_flag and not value:
            if not rest:  # a page that names an option says no value
                return None
            values, rest = rest[: option.nargs], rest[option.nargs :]
            choices = option.type.choices if isinstance(option.type, click.Choice) else values
            if values[0] not in choices and not _PLACEHOLDER.search(values[0]):
                return f"{name} {values[0]}"
    return None


@pytest.mark.parametrize("words", of_program("bmd-rths"))
def test_command_line_has_the_command_and_its_options(words):
    if not words or words[0].startswith("-") or _PLACEHOLDER.search(words[0]):
        return
    assert words[0] in COMMANDS
    command = cli.get_command(None, words[0])
    rest = words[1:]
    if isinstance(command, click.Group):
        if not rest or rest[0].startswith("-"):
            return
        command, rest = command.get_command(None, rest[0]), rest[1:]
        assert command is not None
    assert unknown_option(command, rest) is None


def settings_of(words):
    given = [word for before, word in pairwise(words) if before == "--set"]
    return tuple(word for word in given if not re.search(r"…|=[A-Z]{3,}", word))


@pytest.mark.parametrize("words", [case for case in of_program("bmd-rths") if settings_of(case.values[0])])
def test_parameters_that_are_set_exist_and_may_have_the_values(words):
    file = next((ROOT / word for word in words if word.endswith(".yaml") and (ROOT / word).is_file()), None)
    config = Config() if file is None else load_config(file)
    config.changed(**parsed_settings(settings_of(words)))


def test_reference_has_every_command_once():
    page = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `bmd-rths ([a-z-]+)", page, flags=re.MULTILINE)) == sorted(COMMANDS)


def every_option(command):
    """Return the options of a command and of its subcommands."""
    found = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
    if isinstance(command, click.Group):
        found |= {name for sub in command.list_commands(None) for name in every_option(command.get_command(None, sub))}
    return found


#: Options of other programs that pages name.
_OF_OTHERS = {"--help", "--dist", "--check", "--pip-args", "--params-file", "--show-args", "--ros-args"}


def named_options(text):
    """Return the options that the text of a page names, outside its blocks of code."""
    prose = re.sub(r"^[ ]*```.*?^[ ]*```", "", text, flags=re.MULTILINE | re.DOTALL)
    code = re.findall(r"`([^`\n]*)`", prose)
    return {option for words in code for option in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", words)}


def test_options_that_the_text_names_exist():
    scripts = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "benchmarks").glob("*.py"))
    known = every_option(cli) | _OF_OTHERS | set(re.findall(r'"(--[a-z-]+)"', scripts))
    assert {page.name: found for page in PAGES if (found := named_options(page.read_text("utf-8")) - known)} == {}
    assert named_options("Use `--lockstep` or `run --gone 3`, not `a--b`.\n```sh\nx --y\n```\n") == {
        "--lockstep",
        "--gone",
    }


@pytest.mark.parametrize("words", of_program("ros2", "run", "bmd_rths_nodes"))
def test_executable_exists(words):
    scripts = {path.name for path in (ROOT / "bmd_rths_nodes" / "scripts").iterdir()}
    assert _PLACEHOLDER.search(words[0]) or words[0] in {*scripts, "bmd-rths"}


@pytest.mark.parametrize("words", of_program("ros2", "launch", "bmd_rths_nodes"))
def test_launch_argument_exists(words):
    file = ROOT / "bmd_rths_nodes" / "launch" / words[0]
    declared = re.findall(r"DeclareLaunchArgument\(\s*\"(\w+)\"", file.read_text(encoding="utf-8"))
    given = [word.partition(":=")[0] for word in words[1:] if ":=" in word]
    assert set(given) <= set(declared)


@pytest.mark.parametrize("words", of_program("python"))
def test_script_exists_and_has_its_options(words):
    if not words[0].endswith(".py"):
        return
    script = ROOT / words[0]
    assert script.is_file()
    if script.parent.name == "benchmarks":
        text = script.read_text(encoding="utf-8")
        for word in words[1:]:
            if word.startswith("--"):
                assert f'"{word.partition("=")[0]}"' in text


def test_what_a_page_gets_wrong_is_found():
    block = "bmd-rths run a.yaml --compose \\\n  --set run.lockstep=true && FOO=1 ros2 run x y"
    page = f"```sh\n{block}\n```\nSee `bmd-rths rum`.\n"
    (_, run), (_, ros), (_, inline) = commands_of(page)
    assert run == ["bmd-rths", "run", "a.yaml", "--compose", "--set", "run.lockstep=true"]
    assert (ros, inline) == (["ros2", "run", "x", "y"], ["bmd-rths", "rum"])
    command = cli.get_command(None, "run")
    assert unknown_option(command, run[2:]) == "--compose"
    assert unknown_option(command, ["--set"]) is None
    assert unknown_option(cli.get_command(None, "analyze"), ["bag", "--json"]) is None
