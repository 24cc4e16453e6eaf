"""Times phipsi and other programs on the same models in one alternated run: ``python -m validation.speed``."""
