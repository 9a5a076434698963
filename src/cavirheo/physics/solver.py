"""The bubble and its contents, compiled: a finite-volume Rosenbrock solver.

State (dimensionless, docs/physics.md sections 1-4), all extensive so that what nature conserves is conserved to
round-off: in each shell i of the grid

    N_i = R^3 n        moles of gas and vapour per shell volume, n = p/T
    G_i = R^3 n (1-x)  moles of non-condensable gas, x the mole fraction of vapour

and R, U = R', P = (p - p_b) R^3, and m_k, memories of the material. With mole fractions and the mole-averaged
velocity v the contents obey

    n_t + div(n v) = 0,  [n (1-x)]_t + div(n (1-x) v + Fo n grad x) = 0,

v and p' from docs/physics.md (3.7) and (3.8): the system of Estrada et al. 2018 (doi:10.1016/j.jmps.2017.12.006)
rewritten without approximation. A grid without shells means polytropic contents. The laws of the material are two
tables (physics/table.py) and rows of relaxing terms (physics/memory.py); the far-field pressure is a table too.

The Jacobian is analytic: a block-tridiagonal part (2x2 lower-triangular blocks) with a border of five unknowns R, U,
P, p', z, so one linear solve costs O(cells); the memories are eliminated before. Every function that is compiled for
the solver lives in this one file, because numba's cache is renewed only when the file of the entry point changes.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

OK, TOO_MANY_STEPS, STEP_TOO_SMALL, OUTSIDE_LAW = 0, 1, 2, 3
# No fastmath: it gains 7 % and makes the last bits depend on where in memory the arrays lie.
_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def piece(table, x):  # type: ignore[no-untyped-def]
    """The row of a table (physics/table.py) that holds x."""
    low, count = 0, table.shape[0] - 1
    while count > 1:  # x is in one of `count` rows from `low`
        half = count // 2
        low += half if x >= table[low + half, 0] else 0
        count -= half
    return low


@_compiled
def look_up(table, x):  # type: ignore[no-untyped-def]
    """f(x), f'(x), f''(x) from the one quintic of a table that holds x; NaN outside the table."""
    if not table[0, 0] <= x <= table[-1, 0]:
        return math.nan, math.nan, math.nan
    c = table[piece(table, x)]
    t = x - c[0]
    f0 = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6]))))
    f1 = c[2] + t * (2 * c[3] + t * (3 * c[4] + t * (4 * c[5] + t * 5 * c[6])))
    return f0, f1, 2 * c[3] + t * (6 * c[4] + t * (12 * c[5] + t * 20 * c[6]))


@_compiled
def stress(numbers, R, rate):  # type: ignore[no-untyped-def]
    """S at radius R and rate g = U/R, and its derivatives dS/dR, d2S/dR2, dS/dg, d2S/dg2."""
    lam = numbers.stretch
    E, E1, E2 = look_up(numbers.elastic, R * lam)
    V, V1, V2 = look_up(numbers.viscous, abs(rate))  # odd in the rate
    return E + math.copysign(1.0, rate) * V, E1 * lam, E2 * lam * lam, V1, math.copysign(1.0, rate) * V2


@_compiled
def fault(numbers, R, P):  # type: ignore[no-untyped-def]
    """OK, or why a step to this state must be shorter: it is unphysical, or beyond the reach of the elastic law."""
    law = numbers.elastic
    inside = law[0, 0] <= R * numbers.stretch <= law[-1, 0]
    return STEP_TOO_SMALL if not (R > 0 and P > 0) else OK if inside else OUTSIDE_LAW


@_compiled
def accelerate(numbers, t, R, U, p, p_dot, memory):  # type: ignore[no-untyped-def]
    """U' with its derivatives by R, U, p, p' and t, and by the wall's excess pressure b and its rate; docs (2.1)-(2.4).

    b = p - 1/(We R) + S - 1. Keller-Miksis is its enthalpy h(b) = b at constant speed of sound c; Gilmore has Tait's.
    """
    C, We, n = numbers.C, numbers.We, numbers.tait
    rate = U / R
    S, S_R, S_RR, S_g, S_gg = stress(numbers, R, rate)
    bend = S_gg * rate * rate + 2 * S_g * rate
    b = p - 1 / (We * R) + S - 1
    b_R = 1 / (We * R * R) + S_R - S_g * rate / R
    v = p_dot + U / (We * R * R) + S_R * U - S_g * rate * rate  # the rate of b without its R'' part
    v_R = -2 * U / (We * R * R * R) + S_RR * U + bend * rate / R
    v_U = 1 / (We * R * R) + S_R - bend / R
    for k in range(memory.size):
        modulus, power, fading = numbers.memory[k]
        s = power * modulus * (1 + memory[k]) / R
        b += modulus * memory[k]
        v -= modulus * memory[k] * fading + s * U
        v_R += s * rate
        v_U -= s
    f, f_t, f_tt = look_up(numbers.driving, t)
    if n == 0:  # i = 1/c, w the factor of the pressure's rate
        h, h_b, h_bb, i, i_b, w, w_U, w_i = b - f, 1.0, 0.0, 1 / C, 0.0, 1.0, 0.0, 0.0
        g_t, g_tt = f_t, f_tt
    else:
        stiff = C * C
        log_x, log_y = math.log1p(n * b / stiff), math.log1p(n * f / stiff)
        x, y, x_n, y_n = math.exp(log_x), math.exp(log_y), math.exp(-log_x / n), math.exp(-log_y / n)
        h = stiff / (n - 1) * (math.expm1((n - 1) / n * log_x) - math.expm1((n - 1) / n * log_y))
        h_b, h_bb = x_n, -x_n / (x * stiff)
        g_t, g_tt = y_n * f_t, y_n * f_tt - y_n / (y * stiff) * f_t * f_t
        i = 1 / (C * math.sqrt(x * x_n))
        i_b = -(n - 1) * i / (2 * x * stiff)
        w, w_U, w_i = 1 - U * i, -i, -U
    J = -S_g
    h_t = h_b * v - g_t
    bottom = (1 - U * i) * R + w * i * h_b * J
    value = ((1 + U * i) * h + w * i * R * h_t - 1.5 * U * U + 0.5 * i * U * U * U) / bottom
    top_i = U * h + (w + i * w_i) * R * h_t + 0.5 * U * U * U
    bottom_i = (w + i * w_i) * h_b * J - U * R
    by_b = (1 + U * i) * h_b + w * i * R * h_bb * v + i_b * top_i
    by_b = (by_b - value * (w * i * h_bb * J + i_b * bottom_i)) / bottom
    by_v = w * i * R * h_b / bottom
    by_J = -value * w * i * h_b / bottom
    by_R = (w * i * h_t - value * (1 - U * i)) / bottom + by_b * b_R + by_v * v_R + by_J * S_gg * rate / R
    by_U = (i * h + w_U * i * R * h_t - 3 * U + 1.5 * i * U * U - value * (w_U * i * h_b * J - i * R)) / bottom
    by_U += by_b * S_g / R + by_v * v_U - by_J * S_gg / R
    by_t = -((1 + U * i) * g_t + w * i * R * g_tt) / bottom
    return value, by_R, by_U, by_t, by_b, by_v


@_compiled
def derivatives(t, y, numbers, grid, theta, gas, F, H, out):  # type: ignore[no-untyped-def]
    """Time derivative of the state into `out`; returns p' and z. theta, gas, F, H are work space."""
    M = grid.centre.size
    area, face, left, right, wall = grid.area, grid.face, grid.left, grid.right, grid.wall
    inverse_distance, inverse_volume = grid.inverse_distance, grid.inverse_volume
    A, B, Fo, kappa = numbers.A, numbers.B, numbers.Fo, numbers.kappa
    R, U, P = y[2 * M], y[2 * M + 1], y[2 * M + 2]
    p = numbers.base + P / (R * R * R)
    pressed = P + numbers.base * R * R * R  # p R^3
    memory = y[2 * M + 3 :]
    if M > 0:
        for i in range(M):
            r = 1 / y[i]
            T = pressed * r
            theta[i] = (0.5 * A * (T + 1) + B) * (T - 1)
            gas[i] = y[M + i] * r
        gas_wall = (P + (numbers.base - numbers.pv) * R * R * R) / pressed
        z = (wall[0] * gas_wall + wall[1] * gas[M - 1] + wall[2] * gas[M - 2]) / gas_wall
        heat = (kappa - 1) * numbers.chi * (wall[1] * theta[M - 1] + wall[2] * theta[M - 2]) / R
        p_dot = 3 / R * (-kappa * p * U + heat - kappa * p * Fo * z / R)
    else:
        z, p_dot = 0.0, -3 * numbers.polytropic * (p - numbers.pv) * U / R
    out[2 * M] = U
    out[2 * M + 1] = accelerate(numbers, t, R, U, p, p_dot, memory)[0]
    out[2 * M + 2] = R * R * R * p_dot + 3 * P * U / R
    for k in range(memory.size):
        out[2 * M + 3 + k] = -memory[k] * numbers.memory[k, 2] - numbers.memory[k, 1] * (1 + memory[k]) * U / R
    if M == 0:
        return p_dot, z

    drift = (kappa - 1) * numbers.chi / (kappa * p * R)
    sweep = R * p_dot / (3 * kappa * p) + U
    diffusion = Fo / (R * R)
    for i in range(M - 1):  # fluxes through the faces: F of all moles, H of gas
        w = (drift * (theta[i + 1] - theta[i]) * inverse_distance[i] - sweep * face[i]) * area[i] / R
        N_face = left[i] * y[i] + right[i] * y[i + 1]
        G_face = left[i] * y[M + i] + right[i] * y[M + i + 1]
        F[i + 1] = N_face * w
        H[i + 1] = G_face * w - area[i] * N_face * diffusion * (gas[i + 1] - gas[i]) * inverse_distance[i]
    F[0] = 0.0
    H[0] = 0.0
    F[M] = Fo * p * R * z  # vapour condenses at the wall
    H[M] = 0.0  # gas does not
    for i in range(M):
        out[i] = (F[i] - F[i + 1]) * inverse_volume[i]
        out[M + i] = (H[i] - H[i + 1]) * inverse_volume[i]
    return p_dot, z


@_compiled
def factorise(t, y, numbers, grid, p_dot, z, shift, blocks, border, recall, schur, pivot):  # type: ignore[no-untyped-def]
    """LU factors of (shift - J), eliminated from the centre to the wall.

    blocks (M, 9): inverse diagonal block (NN, GN, GG), block right of it, multipliers of the row above.
    border (M, 10): columns of R, U, P, p', z after the elimination, for the N row and the G row.
    recall (k, 4): factor of each memory m, the derivatives of m' by R and U, and that of U' by m.
    schur (5, 5), pivot (5,): factors of the border. Returns dU'/dt and the border rows' couplings to the last shells.
    """
    M = grid.centre.size
    area, face, left, right, wall = grid.area, grid.face, grid.left, grid.right, grid.wall
    inverse_distance, inverse_volume = grid.inverse_distance, grid.inverse_volume
    A, B, Fo, kappa = numbers.A, numbers.B, numbers.Fo, numbers.kappa
    R, U, P = y[2 * M], y[2 * M + 1], y[2 * M + 2]
    p = numbers.base + P / (R * R * R)
    pressed = P + numbers.base * R * R * R  # p R^3
    by_P = 1 / (R * R * R)  # dp/dP
    by_R = 3 * P / (R * R * R * R)  # -dp/dR at constant P
    drift = (kappa - 1) * numbers.chi / (kappa * p * R)
    per_rate = R / (3 * kappa * p)
    sweep = per_rate * p_dot + U
    diffusion = Fo / (R * R)

    # derivatives of the face fluxes by the inner (l) and outer (r) shell and by the border unknowns
    F_l = F_r = HN_l = HN_r = HG_l = HG_r = 0.0
    F_R = F_U = F_p = F_q = H_R = H_U = H_p = H_q = 0.0
    i11 = i21 = i22 = s11 = s21 = s22 = 0.0
    r0 = 1 / y[0]
    T0 = pressed * r0
    theta0 = (0.5 * A * (T0 + 1) + B) * (T0 - 1)
    KT0 = (A * T0 + B) * T0
    gas0 = y[M] * r0
    for i in range(M):
        g = inverse_volume[i]
        a11, a21, a22 = -g * F_l, -g * HN_l, -g * HG_l
        d11, d21, d22 = shift - g * F_r, -g * HN_r, shift - g * HG_r
        N_R, N_U, N_p, N_q, N_z = g * F_R, g * F_U, g * F_p, g * F_q, 0.0
        G_R, G_U, G_p, G_q = g * H_R, g * H_U, g * H_p, g * H_q
        c11 = c21 = c22 = 0.0
        if i < M - 1:
            r1 = 1 / y[i + 1]
            T1 = pressed * r1
            theta1 = (0.5 * A * (T1 + 1) + B) * (T1 - 1)
            KT1 = (A * T1 + B) * T1
            gas1 = y[M + i + 1] * r1
            step = inverse_distance[i]
            theta_y, gas_y, KT_y = (theta1 - theta0) * step, (gas1 - gas0) * step, (KT1 - KT0) * step
            w = drift * theta_y - sweep * face[i]
            wl, wr = left[i], right[i]
            N_face = wl * y[i] + wr * y[i + 1]
            G_face = wl * y[M + i] + wr * y[M + i + 1]
            s = area[i]
            x = s / R
            w_l, w_r = KT0 * r0 * drift * step, -KT1 * r1 * drift * step
            k = N_face * diffusion * step
            F_l, F_r = x * (wl * w + N_face * w_l), x * (wr * w + N_face * w_r)
            HN_l = x * G_face * w_l - s * (wl * diffusion * gas_y + k * gas0 * r0)
            HN_r = x * G_face * w_r - s * (wr * diffusion * gas_y - k * gas1 * r1)
            HG_l, HG_r = x * wl * w + s * k * r0, x * wr * w - s * k * r1
            w_R = (-drift * theta_y + 3 * drift * KT_y) / R - face[i] * p_dot / (3 * kappa * p) - w / R
            w_p = (-drift * theta_y + drift * KT_y + per_rate * p_dot * face[i]) / p
            w_q = -per_rate * face[i]
            F_R, F_U, F_p, F_q = x * N_face * w_R, -x * N_face * face[i], x * N_face * w_p, x * N_face * w_q
            H_R = x * G_face * w_R + 2 * x * N_face * diffusion * gas_y
            H_U, H_p, H_q = -x * G_face * face[i], x * G_face * w_p, x * G_face * w_q
            r0, theta0, KT0, gas0 = r1, theta1, KT1, gas1
            d11, d21, d22 = d11 + g * F_l, d21 + g * HN_l, d22 + g * HG_l
            c11, c21, c22 = g * F_r, g * HN_r, g * HG_r
            N_R, N_U, N_p, N_q = N_R - g * F_R, N_U - g * F_U, N_p - g * F_p, N_q - g * F_q
            G_R, G_U, G_p, G_q = G_R - g * H_R, G_U - g * H_U, G_p - g * H_p, G_q - g * H_q
        else:
            N_R, N_p, N_z = N_R - g * Fo * p * z, N_p - g * Fo * R * z, -g * Fo * p * R
        if i > 0:
            m11, m22 = a11 * i11, a22 * i22
            m21 = a21 * i11 + a22 * i21
            d11, d22 = d11 - m11 * s11, d22 - m22 * s22
            d21 -= m21 * s11 + m22 * s21
            blocks[i, 6], blocks[i, 7], blocks[i, 8] = m11, m21, m22
            for j in range(5):
                above = border[i - 1, j]
                border[i, j] = -m11 * above
                border[i, 5 + j] = -m21 * above - m22 * border[i - 1, 5 + j]
        else:
            for j in range(10):
                border[i, j] = 0.0
        border[i, 0] -= N_R - by_R * N_p
        border[i, 1] -= N_U
        border[i, 2] -= N_p * by_P
        border[i, 3] -= N_q
        border[i, 4] -= N_z
        border[i, 5] -= G_R - by_R * G_p
        border[i, 6] -= G_U
        border[i, 7] -= G_p * by_P
        border[i, 8] -= G_q
        i11, i22 = 1 / d11, 1 / d22
        i21 = -d21 * i11 * i22
        s11, s21, s22 = c11, c21, c22
        blocks[i, 0], blocks[i, 1], blocks[i, 2] = i11, i21, i22
        blocks[i, 3], blocks[i, 4], blocks[i, 5] = s11, s21, s22

    # rows of p' and z
    if M > 0:
        rb = 1 / y[M - 2]
        Tb = pressed * rb
        thetab = (0.5 * A * (Tb + 1) + B) * (Tb - 1)
        KTb = (A * Tb + B) * Tb
        gasb = y[2 * M - 2] * rb
        gas_wall = (P + (numbers.base - numbers.pv) * R * R * R) / pressed
        heat = 3 * (kappa - 1) * numbers.chi / (R * R)
        theta_y, KT_y = wall[1] * theta0 + wall[2] * thetab, wall[1] * KT0 + wall[2] * KTb
        q_a, q_b = -heat * wall[1] * KT0 * r0, -heat * wall[2] * KTb * rb
        q_R = (3 * kappa * p * U / R + heat * (3 * KT_y - 2 * theta_y) + 6 * kappa * p * Fo * z / (R * R)) / R
        q_U = -3 * kappa * p / R
        q_p = -3 * kappa * U / R + heat * KT_y / p - 3 * kappa * Fo * z / (R * R)
        q_z = -3 * kappa * p * Fo / (R * R)
        zN_a, zN_b = -wall[1] * gas0 * r0 / gas_wall, -wall[2] * gasb * rb / gas_wall
        zG_a, zG_b = wall[1] * r0 / gas_wall, wall[2] * rb / gas_wall
        z_p = (wall[0] - z) / gas_wall * numbers.pv / (p * p)
    else:
        n = 3 * numbers.polytropic
        q_R, q_U, q_p, q_z, z_p = n * (p - numbers.pv) * U / (R * R), -n * (p - numbers.pv) / R, -n * U / R, 0.0, 0.0
        q_a = q_b = zN_a = zN_b = zG_a = zG_b = 0.0

    # row of U
    _, u_R, u_U, u_t, u_p, u_q = accelerate(numbers, t, R, U, p, p_dot, y[2 * M + 3 :])
    for k in range(recall.shape[0]):
        modulus, power, fading = numbers.memory[k]
        pull = power * (1 + y[2 * M + 3 + k]) / R
        recall[k, 0] = 1 / (shift + fading + power * U / R)
        recall[k, 1], recall[k, 2] = pull * U / R, -pull
        recall[k, 3] = modulus * (u_p - u_q * (fading + power * U / R))
        u_R += recall[k, 0] * recall[k, 1] * recall[k, 3]
        u_U += recall[k, 0] * recall[k, 2] * recall[k, 3]

    schur[:, :] = 0.0
    schur[0, 0], schur[0, 1] = shift, -1.0
    schur[1, 0], schur[1, 1], schur[1, 2], schur[1, 3] = -(u_R - by_R * u_p), shift - u_U, -u_p * by_P, -u_q
    schur[2, 0] = -(3 * R * R * p_dot + 6 * P * U / (R * R)) + 3 * R * R * U * by_R
    schur[2, 1], schur[2, 2], schur[2, 3] = -3 * P / R, shift - 3 * U / R, -R * R * R
    schur[3, 0], schur[3, 1], schur[3, 2] = -(q_R - by_R * q_p), -q_U, -q_p * by_P
    schur[3, 3], schur[3, 4] = 1.0, -q_z
    schur[4, 0], schur[4, 2], schur[4, 4] = by_R * z_p, -z_p * by_P, 1.0
    a, b = M - 1, M - 2
    for j in range(5 if M > 0 else 0):
        Na = blocks[a, 0] * border[a, j]
        Ga = blocks[a, 1] * border[a, j] + blocks[a, 2] * border[a, 5 + j]
        Nb = border[b, j] - blocks[b, 3] * Na
        Gb = border[b, 5 + j] - blocks[b, 4] * Na - blocks[b, 5] * Ga
        Nb, Gb = blocks[b, 0] * Nb, blocks[b, 1] * Nb + blocks[b, 2] * Gb
        schur[3, j] += q_a * Na + q_b * Nb
        schur[4, j] += zN_a * Na + zN_b * Nb + zG_a * Ga + zG_b * Gb
    for k in range(5):
        m = k
        for i in range(k + 1, 5):
            if abs(schur[i, k]) > abs(schur[m, k]):
                m = i
        pivot[k] = m
        if m != k:
            for j in range(5):
                schur[k, j], schur[m, j] = schur[m, j], schur[k, j]
        for i in range(k + 1, 5):
            schur[i, k] /= schur[k, k]
            for j in range(k + 1, 5):
                schur[i, j] -= schur[i, k] * schur[k, j]
    return u_t, q_a, q_b, zN_a, zN_b, zG_a, zG_b


@_compiled
def back_substitute(r, M, blocks, border, recall, schur, pivot, couplings, b):  # type: ignore[no-untyped-def]
    """Solve (shift - J) u = r in place with the factors; b (5,) is work space."""
    for i in range(1, M):
        above = r[i - 1]
        r[M + i] -= blocks[i, 7] * above + blocks[i, 8] * r[M + i - 1]
        r[i] -= blocks[i, 6] * above
    b[0], b[1], b[2], b[3], b[4] = r[2 * M], r[2 * M + 1], r[2 * M + 2], 0.0, 0.0
    if M > 0:
        _, q_a, q_b, zN_a, zN_b, zG_a, zG_b = couplings
        k, m = M - 1, M - 2
        Na = blocks[k, 0] * r[k]
        Ga = blocks[k, 1] * r[k] + blocks[k, 2] * r[M + k]
        Nb = r[m] - blocks[m, 3] * Na
        Gb = r[M + m] - blocks[m, 4] * Na - blocks[m, 5] * Ga
        Nb, Gb = blocks[m, 0] * Nb, blocks[m, 1] * Nb + blocks[m, 2] * Gb
        b[3] = q_a * Na + q_b * Nb
        b[4] = zN_a * Na + zN_b * Nb + zG_a * Ga + zG_b * Gb
    for k in range(recall.shape[0]):
        b[1] += recall[k, 0] * recall[k, 3] * r[2 * M + 3 + k]
    for i in range(5):  # rows of the factors were swapped whole, so all exchanges come first
        j = pivot[i]
        b[i], b[j] = b[j], b[i]
    for i in range(5):
        for j in range(i):
            b[i] -= schur[i, j] * b[j]
    for i in range(4, -1, -1):
        for j in range(i + 1, 5):
            b[i] -= schur[i, j] * b[j]
        b[i] /= schur[i, i]
    r[2 * M], r[2 * M + 1], r[2 * M + 2] = b[0], b[1], b[2]
    for k in range(recall.shape[0]):
        r[2 * M + 3 + k] = recall[k, 0] * (r[2 * M + 3 + k] + recall[k, 1] * b[0] + recall[k, 2] * b[1])
    b0, b1, b2, b3, b4 = b[0], b[1], b[2], b[3], b[4]
    N = G = 0.0
    for i in range(M - 1, -1, -1):
        s = border[i]
        t = blocks[i]
        n = r[i] - (s[0] * b0 + s[1] * b1 + s[2] * b2 + s[3] * b3 + s[4] * b4) - t[3] * N
        g = r[M + i] - (s[5] * b0 + s[6] * b1 + s[7] * b2 + s[8] * b3 + s[9] * b4) - t[4] * N - t[5] * G
        N = t[0] * n
        G = t[1] * n + t[2] * g
        r[i] = N
        r[M + i] = G


@_compiled
def reach(table, t):  # type: ignore[no-untyped-def]
    """The longest step from t that passes over no piece of the table unseen: to the end of the next one."""
    return table[min(piece(table, t) + 2, table.shape[0] - 1), 0] - t


@_compiled
def report(k, x, h, M, numbers, y, slope, trial, next_slope, out, fields):  # type: ignore[no-untyped-def]
    """Row k of the results, a fraction x of the step h from y to trial."""
    # quintic Hermite in R, whose first two derivatives are known at both ends; cubic in all else
    R0, V0, A0 = y[2 * M], h * y[2 * M + 1], h * h * slope[2 * M + 1]
    D, V1, A1 = trial[2 * M] - R0, h * trial[2 * M + 1], h * h * next_slope[2 * M + 1]
    c3 = 10 * D - 6 * V0 - 4 * V1 - 1.5 * A0 + 0.5 * A1
    c4 = -15 * D + 8 * V0 + 7 * V1 + 1.5 * A0 - A1
    c5 = 6 * D - 3 * V0 - 3 * V1 - 0.5 * A0 + 0.5 * A1
    R = R0 + x * (V0 + x * (0.5 * A0 + x * (c3 + x * (c4 + x * c5))))
    U = (V0 + x * (A0 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / h
    i = x * x * (3 - 2 * x)
    s0, s1 = h * x * (1 - x) * (1 - x), h * x * x * (x - 1)
    j = 2 * M + 2
    out[k, 0], out[k, 1] = R, U
    P = y[j] + i * (trial[j] - y[j]) + s0 * slope[j] + s1 * next_slope[j]
    out[k, 2] = numbers.base + P / (R * R * R)
    out[k, 3] = stress(numbers, R, U / R)[0]
    for m in range(numbers.memory.shape[0]):
        j = 2 * M + 3 + m
        out[k, 4 + m] = y[j] + i * (trial[j] - y[j]) + s0 * slope[j] + s1 * next_slope[j]
        out[k, 3] += numbers.memory[m, 0] * out[k, 4 + m]
    if fields.size > 0:
        for j in range(2 * M):
            fields[k, j] = y[j] + i * (trial[j] - y[j]) + s0 * slope[j] + s1 * next_slope[j]


@_compiled
def integrate(numbers, grid, method, start, time, rtol, max_steps, to_turn, out, fields, stats):  # type: ignore[no-untyped-def]
    """From the state `start` (3 + k,) R, U, p, m_k, contents at rest and ambient temperature, to time[-1].

    out (time, 4 + k): R, U, p, S, m_k; fields (time, 2 M) or empty: the contents. Rows from a failure on stay as they
    are, and so do those after the end of the first step on which the wall turns from growth to collapse if `to_turn`.
    stats (5,): steps, rejected steps, relative change of the gas in the bubble, time reached, radius there.
    Returns OK, TOO_MANY_STEPS, STEP_TOO_SMALL, or OUTSIDE_LAW if no step stays within the laws of the material.
    """
    M, K = grid.centre.size, numbers.memory.shape[0]
    A, C, when, drift, gamma, order = method.A, method.C, method.when, method.drift, method.gamma, method.order
    n, stages = 2 * M + 3 + K, A.shape[0]
    y, trial, slope, next_slope = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    u = np.empty((stages, n))
    theta, gas, F, H = np.empty(M), np.empty(M), np.empty(M + 1), np.empty(M + 1)
    blocks, border, recall = np.zeros((M, 9)), np.zeros((M, 10)), np.zeros((K, 4))
    schur, b, pivot = np.zeros((5, 5)), np.zeros(5), np.zeros(5, np.int64)

    R, p = start[0], start[2]
    for i in range(M):
        y[i], y[M + i] = p * R**3, (p - numbers.pv) * R**3
    y[2 * M :] = start
    y[2 * M + 2] = (p - numbers.base) * R**3
    gas_at_start = (p - numbers.pv) * R**3
    cause = fault(numbers, R, gas_at_start)
    t, h, after_rejection, status = 0.0, 1e-3 if cause == OK else 0.0, False, OK
    k = steps = rejected = 0
    last_error = last_h = 1.0
    p_dot, z = derivatives(t, y, numbers, grid, theta, gas, F, H, slope)
    while k < time.size and time[k] <= 0.0:
        report(k, 0.0, 1.0, M, numbers, y, slope, y, slope, out, fields)
        k += 1
    while k < time.size and not (to_turn and y[2 * M + 1] < 0):
        if steps + rejected >= max_steps:
            status = TOO_MANY_STEPS
            break
        if h < 1e-14 * (1 + t):
            status = OUTSIDE_LAW if cause == OUTSIDE_LAW else STEP_TOO_SMALL
            break
        wish = h
        h = min(h, reach(numbers.driving, t))
        if fields.size > 0:  # the rates at the wall are stiff: only the ends of steps are exact enough
            h = min(h, time[k] - t)
        couplings = factorise(t, y, numbers, grid, p_dot, z, 1 / (h * gamma), blocks, border, recall, schur, pivot)
        for s in range(stages):
            v = u[s]
            if s == 0:
                v[:] = slope
            else:
                trial[:] = y
                for m in range(s):
                    a, w = A[s, m], u[m]
                    if a != 0.0:
                        for j in range(n):
                            trial[j] += a * w[j]
                cause = fault(numbers, trial[2 * M], trial[2 * M + 2])
                if cause != OK:
                    break
                derivatives(t + when[s] * h, trial, numbers, grid, theta, gas, F, H, v)
                for m in range(s):
                    c, w = C[s, m] / h, u[m]
                    for j in range(n):
                        v[j] += c * w[j]
            v[2 * M + 1] += drift[s] * h * couplings[0]
            back_substitute(v, M, blocks, border, recall, schur, pivot, couplings, b)
        error, usable = 0.0, cause == OK
        if usable:
            last = u[stages - 1]
            for j in range(n):
                trial[j] += last[j]
            for j in range(2 * M):
                usable = usable and trial[j] > 0
                e = last[j] / trial[j]
                error += e * e
            error /= max(2 * M, 1)
            e_R, e_P = last[2 * M] / trial[2 * M], last[2 * M + 2] / trial[2 * M + 2]
            e_U = last[2 * M + 1] / (1 + abs(trial[2 * M + 1]))
            error += e_R * e_R + e_U * e_U + e_P * e_P
            for j in range(2 * M + 3, n):  # error of stress, against the ambient pressure or the stress itself
                modulus = numbers.memory[j - 2 * M - 3, 0]
                e = modulus * last[j] / (1 + abs(modulus * trial[j]))
                error += e * e
            error = math.sqrt(error / 4) / rtol
            cause = fault(numbers, trial[2 * M], trial[2 * M + 2])
            usable = usable and error < 1e10 and cause == OK
        if not usable or error > 1:
            rejected += 1
            after_rejection = True
            h *= max(0.2, 0.9 * error ** (-1 / order)) if usable else 0.2
            continue
        p_dot, z = derivatives(t + h, trial, numbers, grid, theta, gas, F, H, next_slope)
        end = time[k] if fields.size > 0 and h == time[k] - t else t + h
        while k < time.size and time[k] <= end:
            report(k, (time[k] - t) / h, h, M, numbers, y, slope, trial, next_slope, out, fields)
            k += 1
        t = end
        steps += 1
        y, trial = trial, y
        slope, next_slope = next_slope, slope
        growth = 0.9 * max(error, 1e-8) ** (-1 / order)
        if (
            steps > 1 and h == wish
        ):  # Gustafsson's control foresees that the error goes on growing: few steps are rejected
            trend = (max(last_error, 1e-2) / max(error * error, 1e-8)) ** (1 / order)
            growth = min(growth, 0.9 * h / last_h * trend)
        last_error, last_h = error, h
        h = max(h * min(growth, 1.0 if after_rejection else 5.0), wish if h < wish else 0.0)
        after_rejection = False
    total = 0.0
    for i in range(M):
        total += y[M + i] / grid.inverse_volume[i]
    if M == 0:  # what a polytropic gas keeps is p_g R^(3 polytropic)
        R = y[2 * M]
        total = y[2 * M + 2] + (numbers.base - numbers.pv) * R**3
        total *= (R / start[0]) ** (3 * numbers.polytropic - 3) / 3
    stats[0], stats[1], stats[2] = steps, rejected, 3 * total / gas_at_start - 1
    stats[3], stats[4] = t, y[2 * M]
    return status
