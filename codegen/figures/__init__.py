"""Charts as plain data, and one renderer: the page of a report embeds them, `draw` makes pictures of them."""
