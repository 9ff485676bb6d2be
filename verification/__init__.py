"""Published problems with numbers, one small script each; `python -m verification` writes docs/verification.md."""
