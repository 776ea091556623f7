"""Tools shared by several studies."""
