"""libcosim through libcosimpy: a native loop, whose observer gives the values of an arm at once."""

from fmpy import read_model_description
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from benchmarks.peers.work import OUTPUTS, H, States, Work, report, timed


def run(work: Work) -> tuple[float, States]:
    """Step all arms in one process, natively connected."""
    variables = read_model_description(work.fmu).modelVariables
    reference = {v.name: v.valueReference for v in variables}
    execution = CosimExecution.from_step_size(step_size=int(H * 1e9))
    slaves = []
    for arm in range(work.n):
        slave = execution.add_local_slave(CosimLocalSlave(work.fmu, f"arm{arm}"))
        for name, value in work.start_values(arm).items():
            execution.real_initial_value(slave, reference[name], value)
        slaves.append(slave)
    for (source, given), (sink, taken) in work.links:
        execution.connect_real_variables(
            slaves[source], reference[given], slaves[sink], reference[taken]
        )
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    outputs = [reference[name] for name in OUTPUTS]

    def step(_k: int) -> States:
        execution.step()
        return [observer.last_real_values(slave, outputs) for slave in slaves]

    return timed(work, step)


if __name__ == "__main__":
    report(run)
