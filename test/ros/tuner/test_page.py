"""The page in a real browser: what is moved there, what is seen, what is refused."""
import re
import signal
import sys

import cv2
import numpy as np
import pytest
from node_bench import Client, NodeProcess, camera_info, fresh_domain, image_message, random_dots
from recordings import stereo, write
from scene_files import write_pfm
from scenes import two_walls
from tuner_process import LIMIT, Tuner, browser, running_tuner, wait_until

from svdm_core import load_preset
from svdm_ros.command_line.parameters import node_parameters
from svdm_ros.tuner.__main__ import main

LEFT, RIGHT, TRUTH = two_walls(60, 90, near=9, far=3, seed=1)
TIMEOUT = 1000 * LIMIT


@pytest.fixture(scope='module')
def chromium():
    with browser() as started:
        yield started


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('tuner')


@pytest.fixture(scope='module')
def pair(folder):
    for name, image in (('left.png', LEFT), ('right.png', RIGHT)):
        cv2.imwrite(str(folder / name), image)
    write_pfm(folder / 'truth.pfm', TRUTH.astype(np.float32))
    return folder / 'left.png', folder / 'right.png'


@pytest.fixture(scope='module')
def tuner(folder, pair):
    with running_tuner(folder, *pair, '--set', 'num_disparities=16', '--truth', folder / 'truth.pfm') as running:
        yield running


@pytest.fixture
def page(chromium, tuner):
    found = opened(chromium, tuner)
    yield found
    if not found.is_closed():
        found.get_by_role('button', name='reset').click()
        wait_until(lambda: not found.locator('.mark:visible').count(), 'the values of the preset')
    found.context.close()


def opened(chromium, tuner, **options):
    context = chromium.new_context(**options)
    context.set_default_timeout(TIMEOUT)
    page = context.new_page()
    page.goto(tuner.address)
    picture(page, 'disparity')
    return page


def picture(page, name, other_than=None):
    """The picture as it is shown, once it is there and another than that one."""
    def source():
        found = page.get_by_alt_text(name, exact=True).get_attribute('src')
        return found if found and found != other_than else None

    return wait_until(source, f'the picture {name}')


def control(page, name):
    return page.locator(f'.control[data-name={name}]')


def unfolded(page, name):
    """The parameter, also where it is folded away at first."""
    if not control(page, name).is_visible():
        page.locator('.group', has=control(page, name)).locator('.q-expansion-item__container > .q-item').click()
    return control(page, name)


def typed(page, name, text):
    field = unfolded(page, name).locator('input').first
    field.fill(text)
    field.press('Enter')


def shown(page, name):
    return control(page, name).locator('input').first.input_value()


def test_a_slider_changes_the_picture_and_the_figures_are_there(page):
    before = picture(page, 'disparity')
    slider = control(page, 'p2').locator('.q-slider__track-container')
    slider.focus()
    for _ in range(9):
        slider.press('ArrowLeft')
    picture(page, 'disparity', other_than=before)
    wait_until(lambda: float(shown(page, 'p2')) < 0.9, 'the value in the field')
    assert control(page, 'p2').locator('.mark').is_visible() and not control(page, 'p1').locator('.mark').is_visible()
    for name in ('time of a frame', 'valid pixels', 'streaks'):
        page.get_by_text(name, exact=True).wait_for()
    page.get_by_role('button', name='reset').click()
    wait_until(lambda: shown(page, 'p2') == '0.9', 'the value of the preset')
    wait_until(lambda: picture(page, 'disparity') == before, 'the picture of the preset')


def test_opening_a_page_and_going_back_move_nothing(chromium, tmp_path, pair):
    """Also where a value lies between two positions of its slider."""
    between = ['alpha=9.123', 'p2=0.815', 'sigma_s=24.0', 'gradient=magnitude', 'num_disparities=16']
    with running_tuner(tmp_path, *pair, '--set', *between) as tuner:
        page = opened(chromium, tuner)
        page.wait_for_timeout(1500)
        assert shown(page, 'alpha') == '9.123' and shown(page, 'p2') == '0.815'
        typed(page, 'p1', '0.0712')
        wait_until(lambda: shown(page, 'p1') == '0.0712', 'the value typed')
        page.get_by_role('button', name='undo').click()
        wait_until(lambda: shown(page, 'p1') == '0.07', 'the value before')
        page.wait_for_timeout(1000)
        assert page.get_by_role('button', name='undo').is_disabled()
        assert shown(page, 'alpha') == '9.123' and not page.locator('.mark:visible').count()
        page.context.close()


def test_a_refused_value_shows_its_reason_and_the_old_one_comes_back(page):
    typed(page, 'w_p', '4')
    control(page, 'w_p').get_by_text('w_p = 4 is not allowed: it must be an integer, 1, 3 ... 101 px').wait_for()
    wait_until(lambda: shown(page, 'w_p') == '23', 'the old value')
    typed(page, 'w_p', 'many')
    control(page, 'w_p').get_by_text("w_p = 'many' is not allowed").wait_for()
    typed(page, 'w_p', '31')
    wait_until(lambda: not control(page, 'w_p').locator('.problem').is_visible(), 'no reason any more')
    assert shown(page, 'w_p') == '31'


def test_what_is_saved_is_what_the_node_loads_and_nothing_is_overwritten(page, folder):
    typed(page, 'p2', '1.2')
    for expected in ('is written', 'exists already'):
        page.get_by_role('button', name='save', exact=True).click()
        page.get_by_label('file name').fill('mine.yaml')
        page.get_by_role('button', name='save file').click()
        page.get_by_text(expected).wait_for()
        if expected == 'exists already':
            page.get_by_role('button', name='cancel').click()
    assert node_parameters(folder / 'mine.yaml').matcher == load_preset('default').replace(p2=1.2, num_disparities=16)


def test_two_sets_are_held_against_each_other(page):
    page.get_by_role('button', name='hold as A').click()
    first = picture(page, 'A')
    typed(page, 'p2', '0.05')
    second = wait_until(lambda: (now := picture(page, 'B')) != first and now, 'another B')
    assert picture(page, 'A') == first != second
    page.get_by_text('differ by more than 1 px', exact=True).wait_for()
    page.get_by_role('button', name='back to A').click()
    wait_until(lambda: shown(page, 'p2') == '0.9', 'the value of A')
    page.get_by_role('button', name='undo').click()
    wait_until(lambda: shown(page, 'p2') == '0.05', 'the value before')
    page.get_by_role('button', name='let go').click()
    wait_until(lambda: not page.get_by_alt_text('A', exact=True).is_visible(), 'no comparison')


def test_two_browsers_see_the_same_and_neither_stops_the_other(chromium, tuner, page):
    other = opened(chromium, tuner)
    typed(page, 'p2', '0.3')
    wait_until(lambda: shown(other, 'p2') == '0.3', 'the value in the other browser')
    assert wait_until(lambda: picture(page, 'disparity') == picture(other, 'disparity'), 'the same picture')
    page.context.close()
    typed(other, 'p2', '0.6')
    wait_until(lambda: shown(other, 'p2') == '0.6', 'a value after the other is closed')


def test_nothing_on_the_page_is_markup_of_others_and_nothing_comes_from_elsewhere(chromium, tmp_path):
    name = '<img src=x onerror=document.title=1>.png'
    cv2.imwrite(str(tmp_path / name), LEFT)
    cv2.imwrite(str(tmp_path / 'right.png'), RIGHT)
    with running_tuner(tmp_path, tmp_path / name, tmp_path / 'right.png') as tuner:
        context = chromium.new_context()
        asked = []
        context.on('request', lambda request: asked.append(request.url))
        page = context.new_page()
        page.goto(tuner.address)
        picture(page, 'disparity')
        assert page.get_by_text(name).count() >= 1 and page.title() != '1'
        typed(page, 'roi', '<b>x</b>')
        page.get_by_text("roi = '<b>x</b>' is not allowed").wait_for(timeout=TIMEOUT)
        assert not [url for url in asked if not url.startswith((tuner.address, 'data:', f'ws://127.0.0.1:{tuner.port}'))]


def test_requests_of_other_pages_are_refused(tuner):
    assert tuner.status() == 200
    assert tuner.status(Origin='http://evil.example') == tuner.status(Host='evil.example') == 403


def test_a_port_that_is_taken_is_told(tuner, folder, pair):
    refused = Tuner(folder, *pair, '--port', str(tuner.port))
    assert refused.exit_code() == 2
    told = rf'tuner: port {tuner.port} of 127.0.0.1 cannot be used \(.*\): name another by --port\n'
    assert re.fullmatch(told, refused.log)
    assert tuner.status() == 200


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_quietly_also_while_a_browser_looks(chromium, tmp_path, pair, number):
    with running_tuner(tmp_path, *pair) as tuner:
        page = opened(chromium, tuner)
        tuner.send(number)
        assert tuner.exit_code() == 0
        assert tuner.log.splitlines() == [f'tuner: {tuner.address}, until Ctrl-C']
        page.context.close()
    assert [path.name for path in tmp_path.iterdir() if path.suffix != '.log'] == []


@pytest.mark.parametrize(('arguments', 'words'), [
    (['gone.mcap'], 'gone.mcap: there is no such file or folder'),
    (['a.png', 'b.png'], 'a.png'),
    (['a', 'b', 'c'], 'give a recording, a folder, or a left and a right image'),
    (['.'], '.: no pairs in it; expected folders left and right'),
    (['.', '--left', '/a'], 'it is no recording'),
    (['--truth', 'x.pfm'], '--truth is for a left and a right image'),
    (['--preset', 'fast'], 'a live node has its own parameters'),
    (['--demo', '--node', '/other'], '--node and --ros-args are for a live node'),
    (['--demo', '--preset', 'nothing'], "no preset 'nothing'"),
    (['--demo', '--set', 'p2=-1'], 'p2 = -1.0 is not allowed'),
    (['--demo', '--folder', 'gone'], 'gone: there is no such folder'),
])
def test_what_is_wrong_at_the_start_is_one_line(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'argv', ['tuner', *arguments])
    assert main() == 2
    told = capsys.readouterr().err
    assert words in told and told.startswith('tuner: ') and told.count('\n') == 1


def test_a_live_node_is_moved_from_the_page(chromium, tmp_path):
    domain = fresh_domain()
    node, client = NodeProcess(domain, tmp_path / 'node.log', '-p', 'num_disparities:=16'), Client(domain)
    left, right = random_dots()

    def send():
        for side in ('left', 'right'):
            client.publish(f'{side}/camera_info', camera_info(side))
        client.publish_pair(image_message(left), image_message(right))

    def until(condition, what):
        return client.spin_until(condition, what, limit=60.0, each=send)

    try:
        client.wait_until_ready(node)
        with running_tuner(tmp_path, ROS_DOMAIN_ID=str(domain)) as tuner:
            page = chromium.new_context().new_page()
            page.goto(tuner.address)
            until(lambda: page.get_by_alt_text('disparity', exact=True).get_attribute('src'), 'a disparity on the page')
            until(lambda: page.get_by_alt_text('left', exact=True).get_attribute('src'), 'the left image')
            typed(page, 'p2', '0.6')
            until(lambda: client.get_parameters('p2')['p2'] == 0.6, 'the value in the node')
            typed(page, 'num_disparities', '5000')
            until(lambda: page.get_by_text('5000').count(), 'the reason of the node')
            until(lambda: shown(page, 'num_disparities') == '16', 'the old value')
            node.kill()
            until(lambda: page.get_by_text('/disparity_node is not there').count(), 'that it is gone')
    finally:
        client.close()
        node.kill()


def test_a_recording_plays_pauses_and_steps(chromium, tmp_path):
    write(tmp_path / 'bag', list(stereo(5)))
    with running_tuner(tmp_path, tmp_path / 'bag', '--set', 'num_disparities=16') as tuner:
        page = opened(chromium, tuner)
        assert picture(page, 'disparity', other_than=picture(page, 'disparity'))
        page.get_by_role('button', name='pause').click()
        page.get_by_role('button', name='play').wait_for()
        page.wait_for_timeout(700)
        paused = picture(page, 'left')
        page.wait_for_timeout(700)
        assert picture(page, 'left') == paused
        page.get_by_role('button', name='step').click()
        stepped = picture(page, 'left', other_than=paused)
        page.wait_for_timeout(500)
        assert picture(page, 'left') == stepped
        page.get_by_text('rate', exact=True).wait_for()
        page.context.close()


def test_the_error_is_shown_where_the_truth_is_known(page):
    page.get_by_text('error: red is too near', exact=False).wait_for()
    error = picture(page, 'third')
    page.get_by_role('button', name='confidence').click()
    assert picture(page, 'third', other_than=error)
    page.get_by_text(re.compile(r'px, .* % off by more than 1 px')).wait_for()
