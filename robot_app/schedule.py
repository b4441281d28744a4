"""The schedule: every task of the robot, in the order in which they are called in lock-step."""

from __future__ import annotations

from shared.runtime.runner import OnFault, Row

#                   name         rate Hz  max age s  budget s  on fault  FIFO priority: the shorter the wait, the higher
ODOMETRY = Row("odometry", 100.0, 0.08, 0.004, OnFault.HALT, 50)
SCAN = Row("scan", 50.0, 0.14, 0.010, OnFault.HALT, 40)  # the scanner's own rate is 25 Hz; one may be lost
CONTROL = Row("control", 50.0, 0.10, 0.010, OnFault.HALT, 45)
COMMANDS = Row("commands", 50.0, 1.00, 0.010, OnFault.RETRY, 30)
DEPTH = Row("depth", 10.0, 0.50, 0.050, OnFault.DEGRADE)
OBSERVE = Row("observe", 50.0, 0.50, 0.010, OnFault.RETRY)  # ten times a second, as soon as the link has room
EXPLORE = Row("explore", 5.0, 2.00, 0.500, OnFault.RETRY)  # a plan takes a while; the car stands meanwhile
TELEMETRY = Row("telemetry", 5.0, 0.50, 0.005, OnFault.RETRY)
POWER = Row("power", 10.0, 1.00, 0.020, OnFault.DEGRADE)
TEMPERATURE = Row("temperature", 1.0, 5.00, 0.020, OnFault.DEGRADE)

TABLE = (ODOMETRY, SCAN, CONTROL, COMMANDS, DEPTH, OBSERVE, EXPLORE, TELEMETRY, POWER, TEMPERATURE)
