"""HELICS: each arm is a federate, stepped by FMPy; they and the broker share one process.

One more federate subscribes to all arms. What is published at a time is seen at the next one that
is granted, so values go over all at once; the first ones are published while initialising.
"""

import helics as h

from benchmarks.peers.fmpy_loop import opened
from benchmarks.peers.work import H, States, Work, report, timed


def federate(name: str, core: str) -> h.HelicsValueFederate:
    """Return a federate whose time is granted in steps of h."""
    info = h.helicsCreateFederateInfo()
    h.helicsFederateInfoSetCoreTypeFromString(info, core)
    h.helicsFederateInfoSetCoreInitString(info, "--federates=1 --broker=broker")
    h.helicsFederateInfoSetTimeProperty(info, h.HELICS_PROPERTY_TIME_PERIOD, H)
    return h.helicsCreateValueFederate(name, info)


def run(work: Work, core: str = "inproc") -> tuple[float, States]:
    """Step all arms, each when its time is granted."""
    broker = h.helicsCreateBroker(core, "broker", f"--federates={work.n + 1}")
    with opened(work) as (arms, inputs, outputs):
        names = [f"arm{i}" for i in range(work.n)]
        federates = [federate(name, core) for name in names]
        says = [
            h.helicsFederateRegisterGlobalPublication(
                fed, f"{name}/state", h.HELICS_DATA_TYPE_VECTOR
            )
            for fed, name in zip(federates, names, strict=True)
        ]
        receives = (
            [
                h.helicsFederateRegisterSubscription(fed, f"{name}/state")
                for fed, name in zip(federates[1:], names[:-1], strict=True)
            ]
            if work.chain
            else []
        )
        taker = federate("taker", core)
        takes = [h.helicsFederateRegisterSubscription(taker, f"{name}/state") for name in names]
        every = [*federates, taker]
        for fed in every:
            h.helicsFederateEnterInitializingModeAsync(fed)
        for fed in every:
            h.helicsFederateEnterInitializingModeComplete(fed)
        for arm, said in zip(arms, says, strict=True):
            h.helicsPublicationPublishVector(said, arm.getReal(outputs))
        for fed in every:
            h.helicsFederateEnterExecutingModeAsync(fed)
        for fed in every:
            h.helicsFederateEnterExecutingModeComplete(fed)

        def step(k: int) -> States:
            for arm, received in zip(arms[1:], receives, strict=work.chain):
                arm.setReal(inputs, h.helicsInputGetVector(received)[:2])
            for arm, said in zip(arms, says, strict=True):
                arm.doStep(k / 10, H)
                h.helicsPublicationPublishVector(said, arm.getReal(outputs))
            for fed in every:
                h.helicsFederateRequestTimeAsync(fed, (k + 1) * H)
            for fed in every:
                h.helicsFederateRequestTimeComplete(fed)
            return [h.helicsInputGetVector(taken) for taken in takes]

        found = timed(work, step)
        for fed in every:
            h.helicsFederateDisconnectAsync(fed)
        for fed in every:
            h.helicsFederateDisconnectComplete(fed)
    h.helicsBrokerWaitForDisconnect(broker, 1000)
    h.helicsCloseLibrary()
    return found


if __name__ == "__main__":
    report(run)
