"""Configurations from strangers: any bytes give a configuration or one line, in bounded time and memory."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bmd_rths_core.config import SECTIONS, Config, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import specs
from tests.conftest import examples

HEAD = "/**:\n  ros__parameters:\n"


def refusal(tmp_path: Path, content: str | bytes) -> str:
    path = tmp_path / "config.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InputError) as caught:
        load_config(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert len(message) < 3000
    assert message.startswith(str(path))
    return message


@pytest.mark.parametrize("bracket", ["[", "{a: ", "- "])
def test_deep_nesting_is_refused(tmp_path: Path, bracket: str) -> None:
    assert "nested more than 30 deep" in refusal(tmp_path, bracket * 20_000)


def test_aliases_that_multiply_are_refused(tmp_path: Path) -> None:
    bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for one, other in zip("abcdefgh", "bcdefghi", strict=True):
        bomb += f"{other}: &{other} [{', '.join([f'*{one}'] * 9)}]\n"
    assert "values with all aliases written out" in refusal(tmp_path, bomb + f"{HEAD}    specimen: {{masses: *i}}\n")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: &a [*a]\n", "an alias that holds itself"),
        ("? [a, b]\n: 1\n", "a key that is no word"),
        ("a: 2001-99-99\n", "not valid YAML: month must be in 1..12"),
        (HEAD + f"    run: {{seed: {'9' * 5000}}}\n", "not valid YAML"),
        (HEAD + f"    run: {{time_step: {'9' * 400}}}\n", "run.time_step: a whole number of 400 digits"),
        (HEAD + f"    run: {{time_step: {'x' * 4000}}}\n", "run.time_step: 'xxx"),
        (b"\xff\xfe\x00", "cannot be read"),
        (b"#" * 2_000_000, "larger than 1000 kB; no configuration is"),
    ],
)
def test_what_is_no_configuration_is_refused_in_one_line(tmp_path: Path, text: str | bytes, problem: str) -> None:
    assert problem in refusal(tmp_path, text)


def test_a_file_without_an_end_is_refused() -> None:
    with pytest.raises(InputError, match="larger than 1000 kB"):
        load_config("/dev/zero")


NUMBERS = [
    (section, name) for section, declared in SECTIONS.items() for name, spec in specs(declared).items() if spec.unit
]


@pytest.mark.parametrize(("section", "name"), NUMBERS)
def test_every_number_has_bounds(section: str, name: str) -> None:
    spec = specs(SECTIONS[section])[name]
    assert spec.lower is not None
    assert spec.upper is not None
    default = getattr(SECTIONS[section](), name)
    for value in (1e200, -1e200, 1e-200, -1e-200):
        with pytest.raises(InputError) as caught:
            Config().changed(**{f"{section}__{name}": [value] if isinstance(default, tuple) else value})
        assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("stiffness", [1e16, 1e17])
def test_nearly_rigid_story_is_refused(stiffness: float) -> None:
    with pytest.raises(InputError, match=r"numerical_substructure\.stiffnesses: \[1e\+1[67]\] is not allowed"):
        Config().changed(numerical_substructure__stiffnesses=[stiffness])


def test_story_that_is_too_fast_for_its_mass_is_refused() -> None:
    with pytest.raises(InputError, match=r"specimen\.stiffnesses: floor 1 of 0\.1 kg moves at up to"):
        Config().changed(specimen__masses=[0.1, 0.1], specimen__stiffnesses=[1e10, 1e10])


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(150), deadline=None)
@given(data=st.data())
def test_any_bytes_give_a_configuration_or_one_line(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "config.yaml"
    content = bytearray(dump_config(Config()).encode())
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 9))] = data.draw(st.binary(max_size=9))
    path.write_bytes(content)
    try:
        config = load_config(path)
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017  (either is right)
    else:
        assert isinstance(config, Config)
