"""What the command ends with.

0 done; 1 the run failed, or a check or comparison does not hold; 2 the input is bad; 130
interrupted, as shells have it of a process that SIGINT ends: 128 + 2.
"""

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
