"""How often a line is told, and troubles that last."""
from svdm_ros.node.log_lines import Line, LogLines, Throttle


def test_a_line_is_told_at_once_then_once_a_period_with_the_number_held_back():
    throttle = Throttle(period=10.0)
    told = [throttle.admit(Line('a', 'text'), float(second)) for second in range(21)]
    assert {second: text for second, text in enumerate(told) if text} == {
        0: 'text', 10: 'text (9 times more since the last such line)',
        20: 'text (9 times more since the last such line)',
    }


def test_lines_of_different_kinds_do_not_hold_each_other_back():
    throttle = Throttle(period=10.0)
    assert throttle.admit(Line('a', 'first'), 0.0) == 'first'
    assert throttle.admit(Line('b', 'second'), 0.0) == 'second'


class Recorder:
    """A logger that keeps what it is told."""

    def __init__(self):
        self.lines = []

    def info(self, message):
        self.lines.append(('info', message))

    def warning(self, message):
        self.lines.append(('warning', message))


def test_a_trouble_that_lasts_is_told_when_it_begins_and_when_it_ends():
    logger = Recorder()
    log = LogLines(logger)
    for text in ('', 'lost 20 %', 'lost 30 %', '', '', 'lost 40 %'):
        log.last(Line('lost', text), 'all there again')
        assert log.trouble == text
    assert logger.lines == [
        ('warning', 'lost 20 %'), ('info', 'all there again'), ('warning', 'lost 40 %')]


def test_a_complaint_comes_before_a_trouble_that_lasts():
    log = LogLines(Recorder())
    log.last(Line('lost', 'lost'), 'over')
    log.complain(Line('bad', 'bad pair'))
    assert log.trouble == 'bad pair'
