"""Both papers' figures and tables, computed anew: records first, then drawings, then pages."""
