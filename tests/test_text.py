"""Text tables."""

from codegen.text import text_table


def test_control_characters_and_ends_of_lines_in_a_cell_leave_the_columns_aligned() -> None:
    table = text_table(("name", "n"), [("\x1b[31mred\u202e", "1"), ("a\nb\tc", "22")])
    assert table.splitlines() == ["name      n", "-------  --", "[31mred   1", "a b c    22"]
