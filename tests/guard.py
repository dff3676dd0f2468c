"""How long tests wait, s. A test that is quick on a machine at rest is slow on one that is busy.

So a wait for what is to come takes as long as only a hang does. A limit of ours that is to run out
leaves to all else the time that a busy machine needs. Where nothing is to come, or nobody is there,
a wait is in vain, and short: what is tested does not depend on how long it is.
"""

GUARD = 180.0
LIMIT = 5.0
VAIN = 0.5
