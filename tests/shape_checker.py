"""What checks the types and array shapes of every annotated function under pytest (see conftest.py)."""

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an int is a good float
