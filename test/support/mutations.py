"""Files that are almost right: bytes changed, cut out, put in, repeated."""
from hypothesis import strategies as st

_PIECES = [
    *b'nan inf 1e999 1e-320 1e308 -1 0 0x1F 1_0 65535 4294967296 { } " \' &a *a !!int !!bool !!timestamp'.split(),
    b'9' * 400, b'\x00', b'\xff\xfe', b'\n', b' ', b'\t', b' ' * 5000, b'[' * 40, b': ', b'- ', b'---\n', b'? ',
    b'<<: ', b'|\n', b'%YAML 1.2\n', b'\x1b[2J', b'\xe2\x80\xae', b'\xff\xff\xff\xff', b'\x7f\xff\xff\xff']


@st.composite
def mutated(draw, originals):
    """(name, bytes) of one of `originals`, a mapping from names to bytes, with one to six changes."""
    name = draw(st.sampled_from(sorted(originals)))
    data = bytearray(originals[name])
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, len(data)))
        length = draw(st.sampled_from([0, 1, 2, 8, 100]))
        repeated = st.just(bytes(data[at:at + length]) * 2)
        data[at:at + length] = draw(st.sampled_from(_PIECES) | st.binary(max_size=4) | repeated)
    return name, bytes(data[:draw(st.sampled_from([len(data), len(data) // 2]))])
