"""The page of the parameters says what the code declares."""

import runpy
from pathlib import Path

import pytest

from bmd_rths_core.config import SECTIONS, config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import specs

DOCS = Path(__file__).parents[2] / "docs"


def generated():
    return runpy.run_path(str(DOCS / "generate_parameters.py"))["page"]()


def test_page_is_up_to_date():
    written = (DOCS / "reference" / "parameters.md").read_text(encoding="utf-8")
    assert written == generated(), "run: python docs/generate_parameters.py > docs/reference/parameters.md"


def test_every_parameter_has_a_row_in_its_section():
    sections = dict(part.split("\n", 1) for part in generated().split("\n## ")[1:])
    assert list(sections) == list(SECTIONS)
    for name, section in SECTIONS.items():
        rows = [line.split("`")[1] for line in sections[name].splitlines() if line.startswith("| `")]
        assert rows == list(specs(section))


TEXTS = [
    (name, key)
    for name, section in SECTIONS.items()
    for key, spec in specs(section).items()
    if isinstance(getattr(section, key), str) and not spec.choices
]


@pytest.mark.parametrize(("section", "key"), TEXTS)
def test_free_text_must_not_be_empty_as_the_page_says(section, key):
    with pytest.raises(InputError, match=f"{section}.{key}"):
        config_from_mapping({section: {key: ""}})
