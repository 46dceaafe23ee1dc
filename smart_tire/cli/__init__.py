"""Command line ``smart_tire``: one module per verb."""
