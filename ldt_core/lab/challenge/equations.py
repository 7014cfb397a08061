"""Equations of motion of the challenge's machines, with all laws that may act in them.

    J' omega' = K(i) i - b omega - laws + m e (x'' sin theta - y'' cos theta)
    L(i) i'   = V - R(T) i - laws - K(i) omega

with the foundation of the machine file, slightly hardening. Dry friction has LuGre's bristles
(Canudas de Wit, Olsson, Åström, Lischinsky, IEEE Transactions on Automatic Control 40 (1995) 419),
their stiffness in proportion to the level; the eddy brake is Smythe's (1942), the winding heats a
housing that cools (a network of two thermal nodes).
"""

from __future__ import annotations

import math

from ldt_core.base.compiled import njit

COPPER = 0.00393  # 1/K, temperature coefficient of copper's resistance
TURNING = 0.05  # rad/s, over which a level that depends on the direction changes
CLUTCH_SPEED = 0.3  # rad/s of slip at which a clutch has three quarters of its torque
WINDOW_EDGE = 0.02  # s, in which a load comes and goes
PLAY_RATE = 50.0  # 1/s, at which a memory follows the edge of its play
STALL_WIDTH = 1.0  # rad/s, over which a propeller stalls


@njit(error_model="numpy")
def dry_friction(omega, bristle, torque, p):  # pragma: no cover - compiled
    """(friction torque [N m], rate of the bristles' deflection [rad/s])."""
    ahead = 0.5 * (1.0 + math.tanh(omega / TURNING))
    level = ahead * p.forward + (1.0 - ahead) * p.backward
    speed = abs(omega)
    if p.static > 0.0:
        level += p.static * math.exp(-((speed / p.stribeck_speed) ** p.stribeck_power))
    level += p.gear * abs(torque)
    level *= 1.0 + p.weakening * math.exp(-speed / p.weakening_speed)
    rate = omega - speed * bristle / p.bristle
    share = bristle / p.bristle + p.bristle_damping * rate / (1.0 + (omega / TURNING) ** 2)
    return level * share, rate


@njit(error_model="numpy")
def drag(omega, p):  # pragma: no cover - compiled
    """Torque of what turns in a fluid or a magnetic field [N m]."""
    speed = abs(omega)
    torque = p.b * omega
    if p.eddy != 0.0:
        level = p.eddy if omega >= 0.0 else p.eddy_backward
        torque += level * omega / (1.0 + (omega * p.eddy_slowness) ** 2)
    if p.drag != 0.0:
        ratio = speed / p.drag_speed
        size = p.drag * p.drag_speed**2 * (ratio**p.drag_power + p.drag_linear * ratio)
        if p.stall_share > 0.0:
            stalled = 0.5 * (1.0 + math.tanh((speed - p.stall_speed) / STALL_WIDTH))
            size *= 1.0 - p.stall_share * stalled
        torque += math.copysign(size, omega)
    if p.band != 0.0:
        off = (speed - p.band_speed) / p.band_width
        torque += p.band * math.tanh(omega) / (1.0 + off * off)
    return torque


@njit(error_model="numpy")
def load(t, theta, omega, memory, p):  # pragma: no cover - compiled
    """Torque of what the shaft carries and of its ripples [N m]."""
    torque = 0.0
    if p.load != 0.0:
        torque += p.load * (1.0 + p.load_growth * math.tanh(theta / p.load_angle))
    if p.cog != 0.0:
        angle = p.cog_periods * theta + p.cog_phase
        ripple = math.sin(angle) + p.cog_second * math.sin(2.0 * angle + p.cog_second_phase)
        torque += p.cog * ripple
    if p.gravity != 0.0:
        angle = theta + p.gravity_phase
        torque += p.gravity * (math.cos(angle) + p.gravity_second * math.cos(2.0 * angle))
    if p.spring != 0.0:
        turned = (theta / p.spring_angle) ** 2
        torque += p.spring * theta * (1.0 + p.spring_rise * turned / (1.0 + turned))
    if p.pulse != 0.0:
        beat = math.sin(p.pulse_rate * t + p.pulse_phase)
        torque += p.pulse * (beat + 0.4 * (2.0 * beat * beat - 1.0))
    if p.window != 0.0:
        come = math.tanh((t - p.window_from) / WINDOW_EDGE)
        torque += 0.5 * p.window * (come - math.tanh((t - p.window_to) / WINDOW_EDGE))
    if p.belt != 0.0:
        torque += p.belt * math.sin(p.belt_order * theta + p.belt_phase)
    if p.hysteresis != 0.0:
        torque -= p.hysteresis * (memory - omega) / p.hysteresis_width
    return torque


@njit(error_model="numpy")
def play(inside, width):  # pragma: no cover - compiled
    """What is left of a difference beyond a play of that half width, either way."""
    if inside > width:
        return inside - width
    if inside < -width:
        return inside + width
    return 0.0


@njit(error_model="numpy")
def coupling(y, p):  # pragma: no cover - compiled
    """Torque that goes through the coupling to the far end [N m]."""
    slip = y[1] - y[12]
    if p.clutch > 0.0:
        return p.clutch * math.tanh(slip / CLUTCH_SPEED)
    twist = play(y[0] - y[11], p.backlash)
    torque = p.coupling * twist * (1.0 + p.coupling_cubic * twist * twist)
    if twist != 0.0 or p.backlash == 0.0:
        torque += p.coupling_damping * slip
    return torque


@njit(error_model="numpy")
def lost_voltage(y, volts, p):  # pragma: no cover - compiled
    """What the winding, the brushes and the drive take from the supply's voltage [V]."""
    i = y[2]
    size = abs(i)
    lost = p.R * (1.0 + COPPER * y[8]) * i
    if p.contact != 0.0:
        lost += p.contact * math.exp(-size / p.contact_current) * i
    lost += p.source * (1.0 + p.source_rise * size) * i
    if p.brush != 0.0:
        rise = 1.0 + p.brush_rise * size / (1.0 + size)
        lost += p.brush * math.tanh(i / p.brush_current) * rise
    if p.block != 0.0 and (volts == 0.0 or i * volts < 0.0):
        lost += p.block / (1.0 + p.block_fall * size) * i
    if p.open != 0.0 and volts == 0.0:
        lost += p.open / (1.0 + p.open_fall * size) * i
    if size > p.current_limit:
        lost += p.current_contact * play(i, p.current_limit)
    over = abs(y[1]) - p.speed_limit
    if over > 0.0 or (p.limiter_gain > 0.0 and y[16] > 0.0):
        lost += math.copysign(y[16] + 0.5 * max(over, 0.0), y[1])
    return lost


@njit(error_model="numpy")
def rates(t, y, volts, p, dy):  # pragma: no cover - compiled
    """Write the derivative of the state `y` (in the order of `case_plant.STATES`) to `dy`."""
    theta, omega, i = y[0], y[1], y[2]
    supplied = volts
    if p.actuator_time > 0.0:
        dy[10] = (volts - y[10]) / p.actuator_time
        supplied = y[10]
    squared = i * i
    k, inductance = p.K, p.L
    if p.flux_loss != 0.0:
        k *= 1.0 - p.flux_loss * squared / (squared + p.flux_current**2)
    if p.inductance_loss != 0.0:
        inductance *= 1.0 - p.inductance_loss * squared / (squared + p.inductance_current**2)
    dy[2] = (supplied - lost_voltage(y, supplied, p) - k * omega) / inductance
    torque = k * i - drag(omega, p) - load(t, theta, omega, y[16], p)
    if p.forward + p.backward + p.static + p.gear > 0.0:
        friction, dy[7] = dry_friction(omega, y[7], k * i, p)
        torque -= friction
    if p.far > 0.0:
        through = coupling(y, p)
        torque -= through
        dy[11] = y[12]
        dy[12] = through / p.far
    if p.fluid > 0.0:
        dy[13] = (omega - y[13]) / p.fluid_time
        torque -= p.fluid * dy[13]
    if p.heat_winding > 0.0:
        losses = p.R * (1.0 + COPPER * y[8]) * squared
        flow = (y[8] - y[9]) / p.heat_winding
        dy[8] = (losses - flow) * p.heat_winding / p.time_winding
        if p.heat_housing > 0.0:
            dy[9] = (flow * p.heat_housing - y[9]) / p.time_housing
    if p.lag_1 > 0.0:
        dy[14] = (omega - y[14]) / p.lag_1
        if p.lag_2 > 0.0:
            dy[15] = (y[14] - y[15]) / p.lag_2
    if p.hysteresis != 0.0:
        dy[16] = PLAY_RATE * play(omega - y[16], p.hysteresis_width)
    elif p.limiter_gain > 0.0:
        dy[16] = p.limiter_gain * max(abs(omega) - p.speed_limit, 0.0) - p.limiter_leak * y[16]
    dy[0] = omega
    if p.unbalance == 0.0:
        dy[1] = torque / p.J
        return
    s, c = math.sin(theta), math.cos(theta)
    lever = p.unbalance / p.mass
    pull_x = -(p.R_x * y[4] + p.K_x * y[3] * (1.0 + p.duffing * y[3] ** 2)) / p.mass
    pull_y = -(p.R_y * y[6] + p.K_y * y[5] * (1.0 + p.duffing * y[5] ** 2)) / p.mass
    # The mass's own acceleration along x'' sin - y'' cos is lever * alpha; the rest is the pull.
    alpha = (torque + p.unbalance * (pull_x * s - pull_y * c)) / (p.J - p.unbalance * lever)
    dy[1] = alpha
    dy[3] = y[4]
    dy[4] = pull_x + lever * (alpha * s + omega * omega * c)
    dy[5] = y[6]
    dy[6] = pull_y + lever * (omega * omega * s - alpha * c)
