"""`python -m nrs_cosim` is the command `nrs`."""

from nrs_cosim.orchestrator.__main__ import main

main()
