"""The README says what the code says."""
import re
from pathlib import Path

from svdm_core import preset_names
from svdm_ros.parameter_reference import markdown_table

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / 'README.md').read_text()


def test_parameter_table_is_the_one_of_the_code():
    assert markdown_table() in README, 'paste the output of: python -m svdm_ros.parameter_reference'


def test_every_preset_is_named():
    assert [name for name in preset_names() if f'`{name}`' not in README] == []


def test_links_and_pictures_lead_somewhere():
    targets = re.findall(r'\]\(([^)#]+)[^)]*\)', README)
    assert targets
    assert [target for target in targets if '://' not in target and not (ROOT / target).exists()] == []


def test_the_pages_name_only_commands_that_make_knows():
    known = set(re.findall(r'^([a-z]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    for page in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').glob('*.md')):
        assert set(re.findall(r'`make ([a-z]+)', page.read_text())) <= known, page.name
