import pytest
from numba.core.dispatcher import Dispatcher

from station_gui.planning.body import _kernels as body
from station_gui.planning.lattice import _kernels as lattice
from station_gui.planning.rehearsal import rehearse
from station_gui.planning.steering import _kernels as steering
from station_gui.planning.tree import _kernels as tree

# What Python calls; all else is compiled into these.
ENTRIES = (
    body.body_clearance,
    body.where_it_fits,
    lattice.closed_in,
    lattice.search,
    lattice.unwind,
    lattice.ways_to_goal,
    steering.advance,
    steering.change_cost,
    steering.prices,
    steering.shorten,
    tree.grow,
    tree.hang,
    tree.set_edge,
    tree.unwind,
)


@pytest.mark.parametrize("kernel", ENTRIES, ids=lambda kernel: kernel.__name__)
def test_the_rehearsal_makes_each_kernel_ready(kernel: Dispatcher) -> None:
    rehearse()
    assert kernel.signatures
