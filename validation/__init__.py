"""phipsi against other programs and reference data; needs ``pip install -r validation/requirements.txt``."""
