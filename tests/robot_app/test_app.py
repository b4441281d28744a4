from __future__ import annotations

from numba.core.dispatcher import Dispatcher

from robot_app.app import RobotApp
from robot_app.config import load_config
from robot_app.control import _kernels as control_kernels
from robot_app.control.ground import _kernels as ground_kernels
from robot_app.control.ways import _kernels as ways_kernels
from robot_app.perception import _kernels as edge_kernels
from robot_app.perception.completion import _kernels as completion_kernels
from robot_app.perception.curves import _kernels as crease_kernels
from robot_app.perception.curves.sampling import _kernels as sampling_kernels
from robot_app.perception.curves.tracing import _kernels as tracing_kernels
from robot_app.perception.identity import _kernels as identity_kernels
from robot_app.perception.learners.simplified import _kernels as growth_kernels
from robot_app.perception.network import _kernels as network_kernels
from robot_app.perception.refinement import _kernels as refinement_kernels
from shared.link.loopback import loopback_pair
from shared.messages import NumberedCommand, Start
from shared.protocol.codec import encode
from shared.runtime.clock import ManualClock
from shared.runtime.runner import LockstepRunner, Row
from tools.simulator.drivers import SimulatedHardware
from tools.simulator.scenario import find_scenario
from tools.simulator.world import World


def compiled() -> dict[str, int]:
    """How many versions of each kernel of the robot there are."""
    modules = (
        control_kernels,
        ground_kernels,
        ways_kernels,
        edge_kernels,
        crease_kernels,
        tracing_kernels,
        sampling_kernels,
        growth_kernels,
        completion_kernels,
        network_kernels,
        refinement_kernels,
        identity_kernels,
    )
    return {
        f"{module.__name__}.{name}": len(kernel.signatures)
        for module in modules
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher)
    }


def never(row: Row, error: Exception) -> None:
    raise error


def test_nothing_is_compiled_once_the_app_is_warm() -> None:
    clock = ManualClock()
    world = World(find_scenario("lab"), 1)
    robot, station = loopback_pair()
    app = RobotApp(SimulatedHardware(world, waits=False).hardware, robot, clock, load_config(None), 1)
    app.warm_up()
    before = compiled()
    assert sum(n > 0 for n in before.values()) > 20
    runner = LockstepRunner(app.tasks(), clock, world.advance_to, never)
    runner.run_until(1.0)
    station.send(encode(NumberedCommand(1, Start())))
    for _ in range(8):
        runner.run_until(clock.now_s() + 0.9)
        station.send(encode(NumberedCommand(2, Start())))
    app.shut_down()
    assert compiled() == before
