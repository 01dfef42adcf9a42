"""Measurements against peers, run by `warprt bench`. Every figure is a ratio within one process."""
