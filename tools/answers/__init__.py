"""What all commands and the library answer, kept and compared between two checkouts.

python -m tools.answers keep OLD --checkout PATH    # runs the cases with the code of a checkout
python -m tools.answers keep NEW                    # with that of this one
python -m tools.answers compare OLD NEW             # lists each file that differs; status 1 if any
python -m tools.answers time OLD_CHECKOUT NEW_CHECKOUT    # CPU time, the two by turns

`--only NAME...` takes some cases, as `detect-balls` or `detect-*`. The environment variable
STEREOCAL_REAL_DATA names the folder of recordings; the cases that need it are left out without it.
"""
