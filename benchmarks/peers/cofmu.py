"""CoFmuPy: a master in Python over FMPy, which keeps every output of every step."""

from cofmupy import Coordinator

from benchmarks.peers.work import OUTPUTS, H, States, Work, report, timed


def run(work: Work) -> tuple[float, States]:
    """Step all arms in one process."""
    fmus = [
        {"id": f"arm{arm}", "path": work.fmu, "initialization": work.start_values(arm)}
        for arm in range(work.n)
    ]
    connections = [
        {
            "source": {"id": f"arm{source}", "variable": given},
            "target": {"id": f"arm{sink}", "variable": taken},
        }
        for (source, given), (sink, taken) in work.links
    ]
    coordinator = Coordinator()
    coordinator.start(
        {"fmus": fmus, "connections": connections, "cosim_method": "jacobi", "iterative": False}
    )
    arms = [f"arm{arm}" for arm in range(work.n)]

    def step(_k: int) -> States:
        found = coordinator.master.do_step(H)
        return [[found[arm][name][0] for name in OUTPUTS] for arm in arms]

    return timed(work, step)


if __name__ == "__main__":
    report(run)
