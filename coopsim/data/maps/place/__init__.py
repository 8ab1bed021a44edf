"""Places of maps: a part that is cut out, its roads as a description, and scenarios in such places."""
