"""The standard tests of RiMEA, IMO, NIST and ISO: each is built, measured and judged by one function."""
