"""The README says what the code says."""
import re

from checkout import CHECKOUT

from svdm_core import preset_names
from svdm_ros.node.parameter_reference import markdown_table

README = (CHECKOUT / 'README.md').read_text()


def test_parameter_table_is_the_one_of_the_code():
    assert markdown_table() in README, 'paste the output of: python -m svdm_ros.node.parameter_reference'


def test_every_preset_is_named():
    assert [name for name in preset_names() if f'`{name}`' not in README] == []


def test_links_and_pictures_lead_somewhere():
    targets = re.findall(r'\]\(([^)#]+)[^)]*\)', README)
    assert targets
    assert [target for target in targets if '://' not in target and not (CHECKOUT / target).exists()] == []


def test_the_pages_name_only_commands_that_make_knows():
    known = set(re.findall(r'^([a-z]+):', (CHECKOUT / 'Makefile').read_text(), re.MULTILINE))
    for page in (CHECKOUT / 'README.md', CHECKOUT / 'CONTRIBUTING.md', *(CHECKOUT / 'docs').glob('*.md')):
        assert set(re.findall(r'`make ([a-z]+)', page.read_text())) <= known, page.name
