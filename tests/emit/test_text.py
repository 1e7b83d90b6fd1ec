"""Words and numbers as C text: no user text can end a comment, and every number reads back to its bits."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from codegen.emit.text import check_prefix, comment_text, literal
from codegen.errors import BuildError


@example("*\\/")
@example("????/")
@given(st.text(max_size=15) | st.text(alphabet='*/\\?"\n a', max_size=40))
def test_no_text_leaves_its_comment(text: str) -> None:
    safe = comment_text(text)
    assert all(" " <= character <= "~" for character in safe)
    for dangerous in ("*/", "/*", "\\", '"', "??"):
        assert dangerous not in safe


@pytest.mark.parametrize("prefix", ["test", "all", "install", "class", "a__b", "a_", "_a", ""])
def test_prefixes_that_collide(prefix: str) -> None:
    with pytest.raises(BuildError, match="prefix"):
        check_prefix(prefix)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_single_literal_reads_back_to_its_bits(number: float) -> None:
    text = literal(number, "single")
    assert text.endswith("f")
    assert "." in text
    assert np.float32(text[:-1]).tobytes() == np.float32(number).tobytes()


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 1e39])
def test_number_without_a_literal(number: float) -> None:
    with pytest.raises(ValueError, match="literal"):
        literal(number, "single")
