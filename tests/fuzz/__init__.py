"""Files that are damaged at random: whole ones and their readers, and ways to damage them."""
