"""Attacks: generated bad input and bad luck, with seeds. CONTRIBUTING and docs/promises.md say how to run them.

Each module has families of attacks. A family yields cases, which its seed and their number determine, and runs one
in an empty folder: it returns what came of it, and raises where something happened that is not promised. `families.py`
lists them, `__main__.py` runs them with limits of time and memory, and `test_attacks.py` a share of them.
"""
