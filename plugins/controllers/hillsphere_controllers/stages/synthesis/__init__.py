"""The stage ``synthesis``: a controller of linear models, by one of several methods."""
