"""Force elements, one a file: what each exerts, how that varies, what it stores, and what integrators must know of it.

`table` lists them; all others ask its functions and predicates, and none names a kind.
"""
