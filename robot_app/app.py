"""The robot app: makes everything from the hardware and the link it is given, and says what runs when."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from importlib.metadata import version

from robot_app import schedule
from robot_app.config import AnyRobotConfig
from robot_app.drivers.base import (
    Count,
    DeviceError,
    Hardware,
    ImuSample,
    PowerSample,
    RawScan,
    Setting,
    TemperatureSample,
)
from robot_app.mission import RUNNING, Mission
from robot_app.mission_store import MissionStore
from robot_app.perception.identity.tracker import ObjectTracker
from robot_app.perception.object_extractor import ObjectExtractor
from robot_app.platform import StallWatches, hello_of, make_platform, warm_up_control
from robot_app.safety.guard import Guard
from robot_app.safety.motion import Alarm, MotionWatch
from robot_app.safety.motors import Motors
from robot_app.safety.plausible import ImuWatch, ScanWatch
from robot_app.sensing.observation import observe
from robot_app.sensing.scan_filter import thin, thinned_geometry
from robot_app.uplink import Uplink
from robot_app.vitals import VitalsMeter
from shared.link.base import Link, LinkPath
from shared.messages import (
    Command,
    EmergencyStop,
    MissionState,
    ObjectNetwork,
    Start,
    Stop,
    StopReason,
    Telemetry,
)
from shared.runtime.clock import Clock
from shared.runtime.latest import Latest
from shared.runtime.runner import OnFault, Row, Task, TaskHealth

_log = logging.getLogger(__name__)
_READ_TIMEOUT_S = 0.015
_OBSERVE_S = 0.1
_DEPTH_WHILE_WARM = 3  # one image of so many
_GENTLE = {StopReason.NONE, StopReason.COMMAND_SILENCE, StopReason.LOW_BATTERY, StopReason.OVER_TEMPERATURE}
_CUT = {StopReason.EMERGENCY}
_HARD = {StopReason.STALLED, StopReason.TILTED, StopReason.ENCODER_FAULT, StopReason.SENSORS_DISAGREE}
_CONTROL_HUNG_S = 0.06  # without a whole control tick for so long another thread brakes


class RobotApp:
    """Cannot tell a real robot from a simulated one."""

    def __init__(
        self,
        hardware: Hardware,
        link: Link,
        clock: Clock,
        config: AnyRobotConfig,
        boot_id: int,
        store: MissionStore | None = None,
    ) -> None:
        """`boot_id`: below 2**32, another one at each start of the app. Without a `store` no mission is kept."""
        self._boot_id = boot_id
        self._hardware = hardware
        self._clock = clock
        self._config = config
        self._geometry = thinned_geometry(hardware.scanner.geometry)
        self._mission = Mission(config.mission)
        self._store = store
        if store is not None:
            self._mission.restore(store.load())
        platform = make_platform(config, self._mission)
        self._odometry, self._pilot = platform.odometry, platform.pilot
        self._extractor = ObjectExtractor(config.perception, hardware.camera.intrinsics, config.camera)
        self._tracker = ObjectTracker(config.perception.tracking)
        self._guard = Guard(config.safety, schedule.SCAN.max_age_s, schedule.ODOMETRY.max_age_s, clock.now_s())
        self._stall = StallWatches(config.safety.stall)
        self._uplink = Uplink(link, hello_of(config, version("low-bandwidth-mapper")), self._tracker.steadied)
        self._scan: Latest[RawScan] = Latest()
        self._objects: Latest[ObjectNetwork] = Latest()
        self._power: Latest[PowerSample] = Latest()
        self._temperature: Latest[TemperatureSample] = Latest()
        self._standing_reason = StopReason.NONE
        self._control_s = clock.now_s()
        self._hung_since_s: float | None = None
        self._motors = Motors(hardware.drive, self._pilot.brake, self._pilot.cut)
        self._has_lost_wheels = False
        self._halt_text = ""
        self._scan_watch, self._imu_watch = ScanWatch(config.safety.min_beams), ImuWatch()
        self._motion_watch = MotionWatch(
            config.safety, config.body, config.odometry.metres_per_tick(config.body.wheel_radius_m)
        )
        self._is_shut = False
        self._depth_images = 0
        self._vitals = VitalsMeter(hardware, clock.now_s())
        self._sequence = 0
        self._observed_scan_s = -math.inf
        self._observe_due_s = clock.now_s()
        self._observe_waits = False  # for room on the link
        self._sent_objects_s = -math.inf
        self._health: Callable[[], tuple[TaskHealth, ...]] = tuple

    def warm_up(self) -> None:
        """Compile all kernels and touch all buffers; call it before the tasks run."""
        self._uplink.warm_up()
        self._extractor.warm_up()
        self._tracker.warm_up()
        warm_up_control(self._config, self._geometry)

    def tasks(self) -> list[Task]:
        """In the order of the schedule's table."""
        steps = (
            (schedule.ODOMETRY, self._read_motion),
            (schedule.SCAN, self._read_scan),
            (schedule.CONTROL, self._control),
            (schedule.COMMANDS, self._take_commands),
            (schedule.DEPTH, self._read_depth),
            (schedule.OBSERVE, self._observe),
            (schedule.EXPLORE, self._explore),
            (schedule.TELEMETRY, self._report),
            (schedule.POWER, self._read_power),
            (schedule.TEMPERATURE, self._read_temperature),
        )
        return [Task(row, self._watched(row, step)) for row, step in steps]

    def use_health(self, health: Callable[[], tuple[TaskHealth, ...]]) -> None:
        """Where the counters of the tasks are found, for telemetry."""
        self._health = health

    def on_fault(self, row: Row, error: Exception) -> None:
        """What can move stops first; where it is not the control that failed, its next tick goes on braking."""
        if row.on_fault is OnFault.HALT:
            self._brake(self._clock.now_s())

    def stop_for_good(self) -> None:
        """Cut the motor and keep it cut, whatever the tasks still do; the first thing to call at the end."""
        self._is_shut = True
        self._mission.halt(StopReason.SHUTDOWN)
        self._motors.cut()

    def shut_down(self) -> None:
        """Say that it is over and let go of the devices; call it after the tasks have ended."""
        self.stop_for_good()
        self._keep_mission(self._clock.now_s())
        self._report()
        self._hardware.close()

    # --- tasks ---

    def _read_motion(self) -> None:
        """What is left where one of them is lost is read all the same: who brakes for that needs it."""
        lost: DeviceError | None = None
        count = imu = None
        try:
            count = self._hardware.encoders.read(0.0)
        except DeviceError as error:
            lost = error
        self._has_lost_wheels = lost is not None
        try:
            imu = self._hardware.imu.read(0.0)
        except DeviceError as error:
            lost = lost or error
        imu = imu if imu is not None and self._imu_watch.is_alive(imu) else None
        self._odometry.update(count, imu)
        if lost is not None:
            raise lost
        if self._mission.state in RUNNING:
            self._watch_motion(count, imu)
        else:
            self._motion_watch.forget()

    def _watch_motion(self, count: Count | None, imu: ImuSample | None) -> None:
        now_s, state = self._clock.now_s(), self._odometry.state
        alarm = self._motion_watch.update(
            now_s, count, imu, (self._pilot.rolling_mps, state.yaw_rate_radps), self._motors.applied
        )
        stalled = self._stall.update(now_s, self._motors.applied, state) and not self._motion_watch.rests(now_s)
        if alarm is None and stalled:
            alarm = self._motion_watch.stalled(now_s, self._stall.free_mps)
        if alarm is not None:
            self._take_alarm(alarm, now_s)

    def _take_alarm(self, alarm: Alarm, now_s: float) -> None:
        _log.error("%s", alarm.text)
        if alarm.ends_mission:
            self._halt_text = alarm.text
            self._mission.halt(alarm.reason)
        else:
            self._guard.pause(alarm.reason, now_s + alarm.stands_s)
        if alarm.reason is StopReason.SENSORS_DISAGREE:
            self._odometry.doubt_bias()
        self._motors.brake(now_s, self._pilot.rolling_mps, alarm.speed_mps == 0.0, alarm.speed_mps)

    def _read_scan(self) -> None:
        raw = self._hardware.scanner.read(_READ_TIMEOUT_S)
        if raw is not None and self._scan_watch.can_see(raw):
            self._scan.put(thin(raw, self._hardware.scanner.geometry, self._config.scan_filter), raw.stamp_s)

    def _control(self) -> None:
        now_s = self._clock.now_s()
        slow = self._uplink.path is LinkPath.RADIO
        safety = self._config.safety
        self._mission.slow_link = slow
        self._guard.silence_limit_s = safety.command_silence_radio_s if slow else safety.command_silence_s
        scan = self._scan.stamped()
        if scan is not None:
            self._pilot.take_scan(scan.value, self._geometry)
        reason = self._reason_to_stand(now_s)
        if self._must_cut():
            self._motors.cut()
        elif self._must_brake(now_s, reason):
            self._wanted(now_s, may_move=False)  # what has failed must work before the car may drive again
            self._brake(now_s)
            self._motors.check()
        else:
            self._motors.set(self._wanted(now_s, may_move=reason is StopReason.NONE))
        self._control_s = now_s

    def _wanted(self, now_s: float, may_move: bool) -> Setting:
        setting = self._pilot.step(now_s, may_move)
        if not setting.is_finite:
            raise ValueError(f"the controllers ask for {setting}, which is no setting")
        return setting

    def _brake(self, now_s: float) -> None:
        self._motors.brake(now_s, self._pilot.rolling_mps, not self._is_blind(now_s))

    def _take_commands(self) -> None:
        now_s = self._clock.now_s()
        self._uplink.receive(now_s, self._handle, lambda: self._guard.heard(now_s), self._change_hands)
        self._uplink.greet(now_s)
        self._watch_control(now_s)

    def _watch_control(self, now_s: float) -> None:
        """A control that is late for once may go on; one that hangs ends the mission."""
        if now_s - self._control_s <= _CONTROL_HUNG_S:
            self._hung_since_s = None
            return
        self._brake(now_s)
        self._hung_since_s = now_s if self._hung_since_s is None else self._hung_since_s
        if self._mission.state in RUNNING and now_s - self._hung_since_s > self._config.safety.losses.gone_s:
            self._mission.halt(StopReason.TASK_FAULT)

    def _read_depth(self) -> None:
        image = self._hardware.camera.read(_READ_TIMEOUT_S)
        if image is None or self._spares_depth():
            return
        objects = self._extractor.extract(image)
        self._objects.put(objects, image.stamp_s)

    def _spares_depth(self) -> bool:
        """Two of three images while the processor is too warm for all of them."""
        self._depth_images += 1
        return self._guard.spares_processor and self._depth_images % _DEPTH_WHILE_WARM != 0

    def _observe(self) -> None:
        """The newest, at ten a second or as often as the link has room."""
        now_s = self._clock.now_s()
        scan = self._scan.stamped()
        if now_s < self._observe_due_s - 1e-6 or scan is None or scan.stamp_s <= self._observed_scan_s:
            return
        if not self._uplink.has_room:
            self._observe_waits = True
            return
        objects = self._objects.stamped()
        if objects is not None and not self._is_news(objects.stamp_s):
            objects = None
        observation = observe(self._sequence, scan.value, self._geometry, objects, self._odometry, self._boot_id)
        if observation is None:
            return
        self._observed_scan_s = scan.stamp_s
        waited, self._observe_waits = self._observe_waits, False
        if self._uplink.observe(observation, now_s, waited):
            self._observe_due_s = max(self._observe_due_s + _OBSERVE_S, now_s + _OBSERVE_S / 2)
            self._sequence += 1
            if objects is not None:
                self._sent_objects_s = objects.stamp_s

    def _explore(self) -> None:
        now_s, state = self._clock.now_s(), self._odometry.state
        self._mission.at(state.odom_from_robot, state.distance_m)
        self._pilot.explore(now_s)
        self._keep_mission(now_s)

    def _keep_mission(self, now_s: float) -> None:
        if self._store is not None:
            self._store.keep(self._mission.record, now_s)

    def _report(self) -> None:
        state, pilot, now_s = self._odometry.state, self._pilot.state, self._clock.now_s()
        power = self._power.fresh(now_s, schedule.POWER.max_age_s)
        temperature = self._temperature.fresh(now_s, schedule.TEMPERATURE.max_age_s)
        self._uplink.report(
            Telemetry(
                stamp_s=now_s,
                state=self._mission.state,
                stop_reason=self._stop_reason(),
                odom_from_robot=state.odom_from_robot,
                speed_mps=state.speed_mps,
                yaw_rate_radps=state.yaw_rate_radps,
                steering_rad=pilot.steering_rad,
                battery_v=power.battery_v if power is not None else math.nan,
                motor_current_a=power.motor_current_a if power is not None else math.nan,
                cpu_temperature_c=temperature.cpu_c if temperature is not None else math.nan,
                distance_m=state.distance_m,
                late_ticks=sum(h.skipped for h in self._health()),
                following_goal=pilot.following_goal,
                faults=self._faults(),
            )
        )
        self._report_vitals(now_s, temperature)

    def _report_vitals(self, now_s: float, temperature: TemperatureSample | None) -> None:
        if self._uplink.wants_vitals(now_s, temperature.throttling if temperature is not None else ()):
            self._uplink.report_vitals(self._vitals.measure(now_s, self._health(), temperature))

    def _faults(self) -> tuple[str, ...]:
        now_s = self._clock.now_s()
        tasks = [h.fault or f"{h.row.name}: hangs" for h in self._health() if h.fault is not None or h.hangs(now_s)]
        halted = self._mission.state is MissionState.HALTED and self._halt_text
        is_news = halted and not any(self._halt_text in task for task in tasks)
        return (*tasks, *([self._halt_text] if is_news else []), *self._guard.warnings)

    def _read_power(self) -> None:
        power = self._hardware.power.read(_READ_TIMEOUT_S)
        if power is not None:
            self._power.put(power, power.stamp_s)
            self._guard.take_battery(power.battery_v)
            if self._guard.is_home_due and self._mission.state in RUNNING:
                self._guard.sent_home()
                _log.warning(
                    "the battery is low; %s", "driving to the start" if self._mission.go_home() else "going on"
                )

    def _read_temperature(self) -> None:
        temperature = self._hardware.thermometer.read(_READ_TIMEOUT_S)
        if temperature is not None:
            self._temperature.put(temperature, temperature.stamp_s)
            self._guard.take_temperature(temperature.cpu_c, temperature.throttling)

    # --- decisions ---

    def _handle(self, command: Command) -> tuple[bool, str]:
        answer = self._mission.handle(command, self._clock.now_s())
        if isinstance(command, Start) and answer.accepted:
            self._halt_text = ""
        if isinstance(command, EmergencyStop):
            self._motors.cut()
        if isinstance(command, Stop | EmergencyStop):
            _log.warning("stopped by the operator")
        return answer.accepted, answer.reason

    def _change_hands(self) -> None:
        """Another station speaks: it must start the mission itself."""
        if self._mission.state in RUNNING:
            _log.warning("another station has taken over; the mission stops")
            self._mission.halt(StopReason.COMMAND_SILENCE)

    def _reason_to_stand(self, now_s: float) -> StopReason:
        reason = self._guard.reason_to_stand(now_s, self._scan.age_s(now_s), self._odometry.age_s(now_s))
        if reason is not self._standing_reason:
            self._standing_reason = reason
            if self._mission.state in RUNNING:
                _log.warning("standing: %s", reason.name if reason is not StopReason.NONE else "may move again")
        running = self._mission.state in RUNNING
        if self._guard.has_lost(now_s, running):
            self._give_up(reason)
        elif running and self._guard.silence_s(now_s) > self._config.safety.resume_within_s:
            self._mission.halt(StopReason.COMMAND_SILENCE)
        return reason

    def _give_up(self, reason: StopReason) -> None:
        """What the car needs does not come back."""
        self._halt_text = ", ".join(self._guard.faults)
        self._mission.halt(reason)

    def _stop_reason(self) -> StopReason:
        if self._mission.state in {MissionState.HALTED, MissionState.PAUSED}:
            return self._mission.stop_reason
        if self._mission.state is MissionState.IDLE:
            return StopReason.NONE
        hangs = self._clock.now_s() - self._control_s > schedule.CONTROL.max_age_s
        if hangs and self._standing_reason is StopReason.NONE:
            return StopReason.TASK_FAULT  # nobody else would say so
        if self._standing_reason is StopReason.NONE and self._pilot.state.blocked:
            return StopReason.BLOCKED
        return self._standing_reason

    def _must_cut(self) -> bool:
        return self._is_shut or self._halted_for() in _CUT

    def _must_brake(self, now_s: float, reason: StopReason) -> bool:
        """Harder than the speed loop does it, which has what the loop needs."""
        return self._is_blind(now_s) or reason not in _GENTLE or self._halted_for() in _HARD

    def _halted_for(self) -> StopReason:
        """`NONE` while it is not halted."""
        return self._mission.stop_reason if self._mission.state is MissionState.HALTED else StopReason.NONE

    def _is_blind(self, now_s: float) -> bool:
        return self._has_lost_wheels or self._odometry.speed_age_s(now_s) > schedule.ODOMETRY.max_age_s

    def _is_news(self, objects_stamp_s: float) -> bool:
        fresh = self._clock.now_s() - objects_stamp_s <= schedule.DEPTH.max_age_s
        return fresh and objects_stamp_s > self._sent_objects_s

    def _watched(self, row: Row, step: Callable[[], None]) -> Callable[[], None]:
        """A task without which the car must not move keeps it from moving while it fails."""
        if row.on_fault is not OnFault.HALT:
            return step

        def watched() -> None:
            try:
                step()
            except Exception as error:
                reason = StopReason.DEVICE_FAULT if isinstance(error, DeviceError) else StopReason.TASK_FAULT
                self._guard.fault_began(row.name, reason, str(error))
                if row is schedule.CONTROL and reason is StopReason.DEVICE_FAULT and self._mission.state in RUNNING:
                    self._give_up(reason)  # a drive that has failed once is not to be trusted
                raise
            self._guard.fault_ended(row.name)

        return watched
