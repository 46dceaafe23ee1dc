"""Parameters from recordings, with standard errors: nothing here runs live."""
