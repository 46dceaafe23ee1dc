"""The command ``smart_tire``: one verb per file."""
