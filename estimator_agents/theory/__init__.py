"""The theory of linear estimators: spectra, norms, bounds: docs/theory.md derives it."""
