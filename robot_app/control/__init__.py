"""From what the robot sees and wants to a duty and a steering angle.

Nothing here has a thread or a clock; each class is stepped with the time and the values it needs. On each scan,

    memory.add_scan(stamp, ranges, geometry, pose, speed, yaw_rate)     # where something stands
    ground.add_scan(ranges, geometry, pose)                             # what was seen free

then, 20 to 50 times a second,

    points = memory.points_m(now, pose)
    step = wall.step(points, pose, avoided.clearance_ahead_m)           # or path.step(now, pose, speed)
    wish = Wish(step.motion, 0.6, step.carrot_m, may_reverse=True)      # a path: Wish(step.motion, 0.12)
    avoided = avoidance.step(now, wish, points, pose, speed, steering, ground.unseen_m(pose))

and 50 to 200 times a second `speed_controller.step(now, avoided.motion.speed_mps, speed)` gives the duty.
Whatever asks for a motion, the obstacle avoidance has the last word.
"""
