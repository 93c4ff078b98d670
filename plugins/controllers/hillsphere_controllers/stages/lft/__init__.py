"""The stage ``lft``: an uncertain model M-Δ of models at several values of their parameters."""
