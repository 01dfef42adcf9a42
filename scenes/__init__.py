"""Ready scenes, one to a file: Python files with a function scene(), and .cfg files."""
