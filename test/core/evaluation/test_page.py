"""The HTML page of `svdm evaluate`."""
import base64
from html.parser import HTMLParser

import cv2
import numpy as np
from scene_files import KITTI, SIZE, evaluate, truth_off, write_kitti, write_middlebury


class _Page(HTMLParser):
    """What the page refers to, its tables as rows of cells, and the headings."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.tables, self.headings, self.bold, self._open = [], [], [], [], ''
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.addresses += [value for name, value in attrs if name in ('src', 'href', 'srcset', 'data', 'poster')]
        self._open = tag
        if tag == 'table':
            self.tables.append([])
        elif tag == 'tr':
            self.tables[-1].append([])
        elif tag == 'td':
            self.tables[-1][-1].append('')
            self.bold.append((len(self.tables) - 1, len(self.tables[-1]) - 1, len(self.tables[-1][-1]) - 1,
                              'best' in attributes.get('class', '')))

    def handle_endtag(self, _tag):
        self._open = ''

    def handle_data(self, data):
        if self._open == 'td':
            self.tables[-1][-1][-1] += data
        elif self._open in ('h1', 'h2', 'h3'):
            self.headings.append(data)

    def best(self, table):
        """The bold texts of a table."""
        return [self.tables[n][row][cell] for n, row, cell, bold in self.bold if n == table and bold]


def test_the_page_holds_everything_itself(tmp_path):
    write_middlebury(tmp_path / 'data' / 'A & <b>', truth_off(2, -1))
    write_middlebury(tmp_path / 'data' / 'Teddy', seed=5)
    path = tmp_path / 'a.html'
    assert evaluate(tmp_path / 'data', '--method', 'svdm,sgbm-hh', '--html', path) == 0
    text = path.read_text()
    page = _Page(text)
    assert 'http:' not in text and 'https:' not in text and '@import' not in text and 'url(' not in text
    curves = [address for address in page.addresses if address.startswith('data:image/png;base64,')]
    assert len(curves) == 2  # a region each
    for address in curves:
        plot = cv2.imdecode(np.frombuffer(base64.b64decode(address.partition(',')[2]), np.uint8), 1)
        assert plot.shape[1] == 1200 and plot.std() > 10
    pictures = [address for address in page.addresses if address not in curves]
    assert len(pictures) == 2 * 6  # left image, truth, and of both methods disparity and error
    for address in pictures:
        kind, _, data = address.partition(',')
        assert kind == 'data:image/jpeg;base64'
        assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), 1).shape == (*SIZE, 3)
    assert {'A & <b>', 'Teddy'} <= set(page.headings)
    scenes = {row[0]: row[1:] for row in page.tables[0] if row}
    # avgerr of svdm, sgbm-hh, paper for nonocc, then for all; the paper has no average where it lacks a scene
    assert scenes['Teddy'][::3] == ['0.00', '0.00'] and scenes['Teddy'][2::3] == ['3.38', '4.79']
    assert scenes['A & <b>'][2::3] == ['-', '-'] == scenes['weighted average'][2::3]
    assert scenes['A & <b>'][::3] == ['0.10', '0.13']
    assert page.best(0)[0] == '0.10' and '3.38' not in page.best(0)
    assert [row[0] for row in page.tables[1] if row] == ['svdm', 'sgbm-hh']
    svdm, sgbm = (row for row in page.tables[3] if row)  # kept, wrong, surest 100, 80 and 50 %, area, AUC; twice
    assert len(svdm) == len(sgbm) == 1 + 7 + 7 + 1 and '-' in sgbm
    assert svdm[3] == '0.6' and sgbm[3:8] == ['-'] * 5 and sgbm[-1] == '-' != svdm[-1]  # 1 of 84 columns, and none


def test_the_page_of_one_method_on_kitti_has_no_paper(tmp_path):
    write_kitti(tmp_path / 'kitti', *KITTI['KITTI 2012 grey'])
    path = tmp_path / 'a.html'
    assert evaluate(tmp_path / 'kitti', '--set', 'num_disparities=16', '--html', path) == 0
    page = _Page(path.read_text())
    assert [len(row) for row in page.tables[0] if row] == [3, 3] and page.best(0) == []
    assert 'paper' not in path.read_text().lower() and 'Disparity on KITTI 2012, full resolution' in page.headings
