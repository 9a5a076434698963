# mypy: disable-error-code="no-untyped-def"
"""Compiled solver for the bubble and its contents: finite volumes in space, a Rosenbrock method in time.

The state (dimensionless, docs/method/physics.md sections 1-4) is extensive, so that conserved quantities are conserved
to round-off: in each shell i of the grid

    N_i = R^3 n        moles of gas and vapour per shell volume, n = p/T
    G_i = R^3 n (1-x)  moles of non-condensable gas, x the mole fraction of vapour

and R, U = R', P = (p - p_b) R^3, and m_k, memories of the material. With mole fractions and the mole-averaged
velocity v the contents obey

    n_t + div(n v) = 0,  [n (1-x)]_t + div(n (1-x) v + Fo n grad x) = 0,

v and p' from docs/method/physics.md (3.7) and (3.8): the system of Estrada et al. 2018 (doi:10.1016/j.jmps.2017.12.006)
rewritten without approximation; or with a finite rate of condensation and D(T, p), section 3.5 there. A grid without
shells means polytropic contents. The laws of the material are two tables (physics/table.py) and rows of relaxing terms
(`Arm` of physics/laws.py); the far-field pressure is also a table.

The Jacobian is analytic: a block-tridiagonal part (2x2 lower-triangular blocks) with a border of five unknowns R, U,
P, p', z, so one linear solve costs O(shells); the memories are eliminated first. All compiled functions of the solver
are in this file: if it changes, physics/cache.py compiles them all again.
"""

from __future__ import annotations

import math

import numpy as np

from cavirheo.physics.cache import compiled, kernel

OK, TOO_MANY_STEPS, STEP_TOO_SMALL, OUTSIDE_LAW = 0, 1, 2, 3


@kernel
def row_index(table, x):
    """The row of a table (physics/table.py) that holds x."""
    low, count = 0, table.shape[0] - 1
    while count > 1:  # x is in one of `count` rows from `low`
        half = count // 2
        low += half if x >= table[low + half, 0] else 0
        count -= half
    return low


@kernel
def look_up(table, x):
    """f(x), f'(x), f''(x) from the one quintic of a table that holds x; NaN outside the table."""
    if not table[0, 0] <= x <= table[-1, 0]:
        return math.nan, math.nan, math.nan
    c = table[row_index(table, x)]
    t = x - c[0]
    f0 = c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * c[6]))))
    f1 = c[2] + t * (2 * c[3] + t * (3 * c[4] + t * (4 * c[5] + t * 5 * c[6])))
    return f0, f1, 2 * c[3] + t * (6 * c[4] + t * (12 * c[5] + t * 20 * c[6]))


@kernel
def apply_damage(numbers, R):
    """Make the law softer and its stress-free radius larger where the wall turns at R, its smallest radius so far."""
    decades = math.log10(numbers.damage[2] / R)
    softer, wider = numbers.damage[0] ** decades, numbers.damage[1] ** decades
    numbers.damage[2] = R
    for row in numbers.elastic:
        row[0] *= wider
        for k in range(6):
            row[k + 1] *= softer / wider**k


@kernel
def spring(numbers, R):
    """S_el at radius R, and its derivatives dS_el/dR, d2S_el/dR2."""
    lam = numbers.stretch
    E, E1, E2 = look_up(numbers.elastic_falling if numbers.damage[2] > R else numbers.elastic, R * lam)
    return E, E1 * lam, E2 * lam * lam


@kernel
def stress(numbers, R, rate):
    """S without the memories at radius R and rate g = U/R, and its derivatives dS/dR, d2S/dR2, dS/dg, d2S/dg2."""
    E, E_R, E_RR = (0.0, 0.0, 0.0) if numbers.elastic_relaxes else spring(numbers, R)
    V, V1, V2 = look_up(numbers.viscous, abs(rate))  # odd in the rate
    return E + math.copysign(1.0, rate) * V, E_R, E_RR, V1, math.copysign(1.0, rate) * V2


@kernel
def fault(numbers, R, P):
    """OK, or why a step to this state must be shorter: it is unphysical, or outside the range of the elastic law."""
    law = numbers.elastic_falling if numbers.damage[2] > R else numbers.elastic
    inside = law[0, 0] <= R * numbers.stretch <= law[-1, 0]
    return STEP_TOO_SMALL if not (R > 0 and P > 0) else OK if inside else OUTSIDE_LAW


@kernel
def acceleration(numbers, t, R, U, p, p_dot, memory):
    """U' and its derivatives by R, U, t, the wall's excess pressure b (or p) and its rate (or p'); docs (2.1)-(2.4).

    b = p - 1/(We R) + S - 1. Keller-Miksis is its enthalpy h(b) = b at constant speed of sound c; Gilmore has Tait's.
    """
    C, We, n = numbers.C, numbers.We, numbers.tait
    rate = U / R
    S, S_R, S_RR, S_g, S_gg = stress(numbers, R, rate)
    bend = S_gg * rate * rate + 2 * S_g * rate
    loss = numbers.radiation * R * R  # sound along a tube: its pressure is loss U
    b = p - 1 / (We * R) + S - 1 - loss * U
    b_R = 1 / (We * R * R) + S_R - S_g * rate / R - 2 * loss * rate
    v = p_dot + U / (We * R * R) + S_R * U - (S_g * rate + 2 * loss * U) * rate  # the rate of b without its R'' part
    v_R = -2 * U / (We * R * R * R) + S_RR * U + bend * rate / R - 2 * loss * rate * rate
    v_U = 1 / (We * R * R) + S_R - bend / R - 4 * loss * rate
    E, E_R, _ = spring(numbers, R) if numbers.elastic_relaxes else (0.0, 0.0, 0.0)
    for k in range(memory.size):
        modulus, power, relaxation_rate, compliance = numbers.memory[k]
        s = power * modulus * (1 + memory[k]) / R
        b += modulus * memory[k]
        v -= modulus * (memory[k] - compliance * E) * relaxation_rate + s * U
        v_R += s * rate + modulus * compliance * E_R * relaxation_rate
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
    J = loss * R - S_g
    h_t = h_b * v - g_t
    walled = 2 * numbers.inertia * R  # the image bubbles behind the walls move liquid too
    bottom = (1 - U * i + 0.5 * walled) * R + w * i * h_b * J
    value = ((1 + U * i) * h + w * i * R * h_t - (1.5 + walled) * U * U + 0.5 * i * U * U * U) / bottom
    top_i = U * h + (w + i * w_i) * R * h_t + 0.5 * U * U * U
    bottom_i = (w + i * w_i) * h_b * J - U * R
    by_b = (1 + U * i) * h_b + w * i * R * h_bb * v + i_b * top_i
    by_b = (by_b - value * (w * i * h_bb * J + i_b * bottom_i)) / bottom
    by_v = w * i * R * h_b / bottom
    by_J = -value * w * i * h_b / bottom
    by_R = w * i * h_t - 2 * numbers.inertia * U * U - value * (1 - U * i + walled)
    by_R = by_R / bottom + by_b * b_R + by_v * v_R + by_J * S_gg * rate / R + 3 * by_J * loss
    by_U = i * h + w_U * i * R * h_t - (3 + 2 * walled) * U + 1.5 * i * U * U
    by_U = (by_U - value * (w_U * i * h_b * J - i * R)) / bottom
    by_U += by_b * S_g / R - by_b * loss + by_v * v_U - by_J * S_gg / R
    by_t = -((1 + U * i) * g_t + w * i * R * g_tt) / bottom
    return value, by_R, by_U, by_t, by_b, by_v


@kernel
def gas_at_wall(numbers, R, P, w, B):
    """(mole fraction g of gas at the wall, 1/(dz/dB), resistance m); z = w + B/g (w, B: one-sided difference).

    g = (p - p_v)/p - m z: the finite rate of condensation gives the term m z; m = 0 in equilibrium.
    """
    pressed = P + numbers.base * R * R * R  # p R^3
    g = (P + (numbers.base - numbers.pv) * R * R * R) / pressed
    if numbers.condensation_rate == math.inf:
        return g, g, 0.0
    m = numbers.Fo / (numbers.condensation_rate * R)
    if numbers.variable_D:
        m *= R * R * R / pressed
    h = g - m * w
    root = math.sqrt(h * h - 4 * m * B)
    return (0.5 * (h + root) if h > 0 else -2 * m * B / (root - h)), root, m


@kernel
def derivatives(t, y, numbers, grid, theta, gas, F, H, out):
    """Write the time derivative of the state to `out`; returns p' and z. theta, gas, F, H are work space."""
    M = grid.centre.size
    area, face, left, right, wall = grid.area, grid.face, grid.left, grid.right, grid.wall
    inverse_distance, inverse_volume = grid.inverse_distance, grid.inverse_volume
    A, B, Fo, kappa = numbers.A, numbers.B, numbers.Fo, numbers.kappa
    R, U, P = y[2 * M], y[2 * M + 1], y[2 * M + 2]
    p = numbers.base + P / (R * R * R)
    pressed = P + numbers.base * R * R * R  # p R^3
    memory = y[2 * M + 3 :]
    diffusion, carried = (Fo * R, 1.0) if numbers.variable_D else (Fo / (R * R), p)  # D/R^2, and n D/Fo at the wall
    carrier = out[:M] if numbers.variable_D else y[:M]  # n D of each shell: T^0.75, for D = Fo T^1.75/p
    if M > 0:
        for i in range(M):
            r = 1 / y[i]
            T = pressed * r
            theta[i] = (0.5 * A * (T + 1) + B) * (T - 1)
            gas[i] = y[M + i] * r
        if numbers.variable_D:
            for i in range(M):
                T = pressed / y[i]
                carrier[i] = math.sqrt(T * math.sqrt(T))
        B_wall = wall[1] * gas[M - 1] + wall[2] * gas[M - 2]
        gas_wall = gas_at_wall(numbers, R, P, wall[0], B_wall)[0]
        z = (wall[0] * gas_wall + wall[1] * gas[M - 1] + wall[2] * gas[M - 2]) / gas_wall
        heat = (kappa - 1) * numbers.chi * (wall[1] * theta[M - 1] + wall[2] * theta[M - 2]) / R
        p_dot = 3 / R * (-kappa * p * U + heat - kappa * carried * Fo * z / R)
    else:
        z, p_dot = 0.0, -3 * numbers.polytropic * (p - numbers.pv) * U / R
    out[2 * M] = U
    out[2 * M + 1] = acceleration(numbers, t, R, U, p, p_dot, memory)[0]
    out[2 * M + 2] = R * R * R * p_dot + 3 * P * U / R
    E = spring(numbers, R)[0] if numbers.elastic_relaxes else 0.0
    for k in range(memory.size):
        _, power, relaxation_rate, compliance = numbers.memory[k]
        out[2 * M + 3 + k] = (compliance * E - memory[k]) * relaxation_rate - power * (1 + memory[k]) * U / R
    if M == 0:
        return p_dot, z
    drift = (kappa - 1) * numbers.chi / (kappa * p * R)
    sweep = R * p_dot / (3 * kappa * p) + U
    for i in range(M - 1):  # fluxes through the faces: F of all moles, H of gas
        w = (drift * (theta[i + 1] - theta[i]) * inverse_distance[i] - sweep * face[i]) * area[i] / R
        N_face = left[i] * y[i] + right[i] * y[i + 1]
        G_face = left[i] * y[M + i] + right[i] * y[M + i + 1]
        F[i + 1] = N_face * w
        D_face = left[i] * carrier[i] + right[i] * carrier[i + 1]
        H[i + 1] = G_face * w - area[i] * D_face * diffusion * (gas[i + 1] - gas[i]) * inverse_distance[i]
    F[0] = 0.0
    H[0] = 0.0
    F[M] = Fo * carried * R * z  # vapour condenses at the wall
    H[M] = 0.0  # gas does not
    for i in range(M):
        out[i] = (F[i] - F[i + 1]) * inverse_volume[i]
        out[M + i] = (H[i] - H[i + 1]) * inverse_volume[i]
    return p_dot, z


@kernel
def eliminate(y, numbers, grid, p_dot, z, shift, cell, flux, blocks, border):
    """LU-factorise the shells of (shift - J) from the centre to the wall. The grid must have shells.

    Most loops write one array, so that LLVM can rule out overlap and vectorise; only the elimination is sequential.

    cell (5, M), flux (7, M + 1): work space. Column k of flux is the face between shells k-1 and k.
    blocks (9, M), each NN, GN, GG: inverse diagonal block; its product with the block to the right; multipliers of the
    row above.
    border (6, M): inverse diagonal block times the columns of P, R and the sweep, N rows and G rows. U and p' enter the
    fluxes only through the sweep U + R p'/(3 kappa p), z only through the wall.
    """
    M = grid.centre.size
    area, face, left, right = grid.area, grid.face, grid.left, grid.right
    inverse_distance, inverse_volume = grid.inverse_distance, grid.inverse_volume
    A, B, Fo, kappa = numbers.A, numbers.B, numbers.Fo, numbers.kappa
    R, U, P = y[2 * M], y[2 * M + 1], y[2 * M + 2]
    p = numbers.base + P / (R * R * R)
    pressed = P + numbers.base * R * R * R  # p R^3
    drift = (kappa - 1) * numbers.chi / (kappa * p * R)
    swept = R * p_dot / (3 * kappa * p)
    sweep = swept + U
    diffusion, fick = (Fo * R, Fo * R * R) if numbers.variable_D else (Fo / (R * R), Fo / R)
    N, G = y[:M], y[M : 2 * M]
    inverse, theta, KT, gas, by_N = cell[0], cell[1], cell[2], cell[3], cell[4]
    for i in range(M):
        inverse[i] = 1 / N[i]
    for i in range(M):
        T = pressed * inverse[i]
        theta[i] = (0.5 * A * (T + 1) + B) * (T - 1)
        KT[i] = (A * T + B) * T
    for i in range(M):
        gas[i] = G[i] * inverse[i]

    by_N[:] = 1.0  # derivative by N of the diffusing quantity, N or T^0.75
    # on the faces: N and G times area/R, the velocities of conduction and of diffusion, N or T^0.75 times area/R
    n, g, w, v = flux[0, 1:M], flux[1, 1:M], flux[2, 1:M], flux[3, 1:M]
    q = flux[6, 1:M] if numbers.variable_D else n
    if numbers.variable_D:
        for i in range(M):
            T = pressed * inverse[i]
            by_N[i] = math.sqrt(T * math.sqrt(T))
        for i in range(M - 1):
            q[i] = area[i] / R * (by_N[i] + right[i] * (by_N[i + 1] - by_N[i]))
        for i in range(M):
            by_N[i] *= -0.75 * inverse[i]
    for i in range(M - 1):
        n[i] = area[i] / R * (N[i] + right[i] * (N[i + 1] - N[i]))
    for i in range(M - 1):
        g[i] = area[i] / R * (G[i] + right[i] * (G[i + 1] - G[i]))
    for i in range(M - 1):
        w[i] = drift * (theta[i + 1] - theta[i]) * inverse_distance[i]
    for i in range(M - 1):
        v[i] = diffusion * (gas[i + 1] - gas[i]) * inverse_distance[i]

    # columns of P, R and the sweep: first derivatives of the velocity, then of the fluxes, then their differences
    N_flux, G_flux = flux[4], flux[5]
    N_inner, G_inner = N_flux[1:M], G_flux[1:M]
    N_flux[0] = G_flux[0] = G_flux[M] = 0.0
    for k in range(3):
        if k < 2:  # derivative by p, which depends on R too: dp/dR = -3 (p - p_b)/R at constant P
            for i in range(M - 1):
                N_inner[i] = (drift * (KT[i + 1] - KT[i]) * inverse_distance[i] - w[i] + swept * face[i]) / p
        if k == 0:
            by_p, N_wall = 1 / (R * R * R), 0.0 if numbers.variable_D else Fo * R * z / (R * R * R)
            for i in range(M - 1):
                N_inner[i] *= by_p
        elif k == 1:
            by_p, N_wall = 3 * numbers.base / R, Fo * z * (1.0 if numbers.variable_D else 3 * numbers.base - 2 * p)
            for i in range(M - 1):
                N_inner[i] = by_p * N_inner[i] + (w[i] + (sweep - 4 * swept) * face[i]) / R
        else:
            N_wall = 0.0
            for i in range(M - 1):
                N_inner[i] = -face[i]
        for i in range(M - 1):
            G_inner[i] = g[i] * N_inner[i]
        for i in range(M - 1):
            N_inner[i] *= n[i]
        if numbers.variable_D and k < 2:
            for i in range(M - 1):
                G_inner[i] -= (0.75 * R * by_p / p + k) * q[i] * v[i]
        elif k == 1:
            for i in range(M - 1):
                G_inner[i] += 2 * n[i] * v[i]
        N_flux[M] = N_wall
        N_column, G_column = border[k], border[3 + k]
        for i in range(M):
            N_column[i] = inverse_volume[i] * (N_flux[i + 1] - N_flux[i])
        for i in range(M):
            G_column[i] = inverse_volume[i] * (G_flux[i + 1] - G_flux[i])

    # derivatives of the fluxes by the inner and the outer shell, NN, GN, GG
    for i in range(M - 1):
        w[i] = area[i] / R * (w[i] - sweep * face[i])
    for i in range(M - 1):
        v[i] *= area[i]
    for i in range(M - 1):
        n[i] *= inverse_distance[i]
    for i in range(M - 1):
        g[i] *= inverse_distance[i]
    if numbers.variable_D:
        for i in range(M - 1):
            q[i] *= inverse_distance[i]
    for i in range(M):
        KT[i] *= drift * inverse[i]
    for i in range(M):
        gas[i] *= inverse[i]
    d11, d21, d22, c11, c21, c22 = blocks[0], blocks[1], blocks[2], blocks[3], blocks[4], blocks[5]
    a11, a21, a22 = blocks[6], blocks[7], blocks[8]
    for i in range(M - 1):
        a11[i + 1] = left[i] * w[i] + n[i] * KT[i]
    for i in range(M - 1):
        a21[i + 1] = g[i] * KT[i] - left[i] * by_N[i] * v[i] - fick * q[i] * gas[i]
    for i in range(M - 1):
        a22[i + 1] = left[i] * w[i] + fick * q[i] * inverse[i]
    for i in range(M - 1):
        c11[i] = right[i] * w[i] - n[i] * KT[i + 1]
    for i in range(M - 1):
        c21[i] = fick * q[i] * gas[i + 1] - g[i] * KT[i + 1] - right[i] * by_N[i + 1] * v[i]
    for i in range(M - 1):
        c22[i] = right[i] * w[i] - fick * q[i] * inverse[i + 1]
    for k in range(3):  # the rows of (shift - J) from them
        d, c, a = blocks[k], blocks[3 + k], blocks[6 + k]
        a[0] = c[M - 1] = 0.0
        on_diagonal = shift if k != 1 else 0.0
        d[0] = on_diagonal + inverse_volume[0] * a[1]
        for i in range(1, M - 1):
            d[i] = on_diagonal + inverse_volume[i] * (a[i + 1] - c[i - 1])
        d[M - 1] = on_diagonal - inverse_volume[M - 1] * c[M - 2]
        for i in range(M):
            c[i] *= inverse_volume[i]
        for i in range(M):
            a[i] *= -inverse_volume[i]

    i11 = i21 = i22 = s11 = s21 = s22 = 0.0
    e0 = e1 = e2 = f0 = f1 = f2 = 0.0
    for i in range(M):
        m11, m22 = a11[i] * i11, a22[i] * i22
        m21 = a21[i] * i11 + a22[i] * i21
        a11[i], a21[i], a22[i] = m11, m21, m22
        f0 = border[3, i] - m21 * e0 - m22 * f0
        f1 = border[4, i] - m21 * e1 - m22 * f1
        f2 = border[5, i] - m21 * e2 - m22 * f2
        e0, e1, e2 = border[0, i] - m11 * e0, border[1, i] - m11 * e1, border[2, i] - m11 * e2
        border[0, i], border[1, i], border[2, i] = e0, e1, e2
        border[3, i], border[4, i], border[5, i] = f0, f1, f2
        cross = d21[i] - (m21 * s11 + m22 * s21)
        i11, i22 = 1 / (d11[i] - m11 * s11), 1 / (d22[i] - m22 * s22)
        i21 = -cross * i11 * i22
        d11[i], d21[i], d22[i] = i11, i21, i22
        s11, s21, s22 = c11[i], c21[i], c22[i]
    for k in range(3):
        e, f = border[k], border[3 + k]
        for i in range(M):
            f[i] = d21[i] * e[i] + d22[i] * f[i]
        for i in range(M):
            e[i] *= d11[i]
    for i in range(M):
        c21[i] = d21[i] * c11[i] + d22[i] * c21[i]
    for i in range(M):
        c11[i] *= d11[i]
    for i in range(M):
        c22[i] *= d22[i]


@kernel
def factorise(t, y, numbers, grid, p_dot, z, shift, blocks, border, memory_rows, schur, pivot):
    """LU-factorise the border R, U, P, p', z of (shift - J), after `eliminate` has factorised the shells.

    memory_rows (k, 4): for each memory m its inverse pivot, the derivatives of m' by R and U, and that of U' by m.
    schur (5, 5), pivot (5,): factors of the border, with inverse pivots. Returns dU'/dt, the couplings of the
    border rows to the last two shells, the derivative of the sweep by p', and the last shell's column of z.
    """
    M = grid.centre.size
    wall, Fo, kappa = grid.wall, numbers.Fo, numbers.kappa
    R, U, P = y[2 * M], y[2 * M + 1], y[2 * M + 2]
    p = numbers.base + P / (R * R * R)
    pressed = P + numbers.base * R * R * R  # p R^3
    by_P = 1 / (R * R * R)  # dp/dP
    by_R = 3 * P / (R * R * R * R)  # -dp/dR at constant P
    per_rate = R / (3 * kappa * p)
    a, b = M - 1, M - 2

    # rows of p' and z
    if M > 0:
        ra, rb = 1 / y[a], 1 / y[b]
        Ta, Tb = pressed * ra, pressed * rb
        theta_a = (0.5 * numbers.A * (Ta + 1) + numbers.B) * (Ta - 1)
        theta_b = (0.5 * numbers.A * (Tb + 1) + numbers.B) * (Tb - 1)
        KTa, KTb = (numbers.A * Ta + numbers.B) * Ta, (numbers.A * Tb + numbers.B) * Tb
        B_wall = wall[1] * (y[M + a] * ra) + wall[2] * (y[M + b] * rb)
        _, slack, m = gas_at_wall(numbers, R, P, wall[0], B_wall)
        carried, per_p = (1.0, 0.0) if numbers.variable_D else (p, 1.0)  # n D/Fo at the wall, by p
        heat = 3 * (kappa - 1) * numbers.chi / (R * R)
        theta_y, KT_y = wall[1] * theta_a + wall[2] * theta_b, wall[1] * KTa + wall[2] * KTb
        q_a, q_b = -heat * wall[1] * KTa * ra, -heat * wall[2] * KTb * rb
        q_R = (3 * kappa * p * U / R + heat * (3 * KT_y - 2 * theta_y) + 6 * kappa * carried * Fo * z / (R * R)) / R
        q_U = -3 * kappa * p / R
        q_p = -3 * kappa * U / R + heat * KT_y / p - per_p * 3 * kappa * Fo * z / (R * R)
        q_z = -3 * kappa * carried * Fo / (R * R)
        zG_a, zG_b = wall[1] * ra / slack, wall[2] * rb / slack
        zN_a, zN_b = -zG_a * y[M + a] * ra, -zG_b * y[M + b] * rb
        z_p = (wall[0] - z) / slack * numbers.pv / (p * p)
        z_R = (wall[0] - z) / slack * z * m / R
        z_p += (1 - per_p) * z_R * R / p
        z_N = grid.inverse_volume[a] * Fo * carried * R * blocks[0, a]
        z_G = grid.inverse_volume[a] * Fo * carried * R * blocks[1, a]
    else:
        n = 3 * numbers.polytropic
        q_R, q_U, q_p, q_z, z_p = n * (p - numbers.pv) * U / (R * R), -n * (p - numbers.pv) / R, -n * U / R, 0.0, 0.0
        q_a = q_b = zN_a = zN_b = zG_a = zG_b = z_N = z_G = z_R = 0.0
    # row of U
    _, u_R, u_U, u_t, u_p, u_q = acceleration(numbers, t, R, U, p, p_dot, y[2 * M + 3 :])
    E_R = spring(numbers, R)[1] if numbers.elastic_relaxes else 0.0
    for k in range(memory_rows.shape[0]):
        modulus, power, relaxation_rate, compliance = numbers.memory[k]
        pull = power * (1 + y[2 * M + 3 + k]) / R
        memory_rows[k, 0] = 1 / (shift + relaxation_rate + power * U / R)
        memory_rows[k, 1], memory_rows[k, 2] = pull * U / R + compliance * E_R * relaxation_rate, -pull
        memory_rows[k, 3] = modulus * (u_p - u_q * (relaxation_rate + power * U / R))
        u_R += memory_rows[k, 0] * memory_rows[k, 1] * memory_rows[k, 3]
        u_U += memory_rows[k, 0] * memory_rows[k, 2] * memory_rows[k, 3]
    schur[:, :] = 0.0
    schur[0, 0], schur[0, 1] = shift, -1.0
    schur[1, 0], schur[1, 1], schur[1, 2], schur[1, 3] = -(u_R - by_R * u_p), shift - u_U, -u_p * by_P, -u_q
    schur[2, 0] = -(3 * R * R * p_dot + 6 * P * U / (R * R)) + 3 * R * R * U * by_R
    schur[2, 1], schur[2, 2], schur[2, 3] = -3 * P / R, shift - 3 * U / R, -R * R * R
    schur[3, 0], schur[3, 1], schur[3, 2] = -(q_R - by_R * q_p), -q_U, -q_p * by_P
    schur[3, 3], schur[3, 4] = 1.0, -q_z
    schur[4, 0], schur[4, 2], schur[4, 4] = by_R * z_p - z_R, -z_p * by_P, 1.0
    for j in range(5 if M > 0 else 0):
        if j == 4:
            Na, Ga, Nb, Gb = z_N, z_G, 0.0, 0.0
        else:  # columns of R, U, P, p': those of U and p' are multiples of the sweep's
            k, by = (1, 1.0) if j == 0 else (2, 1.0) if j == 1 else (0, 1.0) if j == 2 else (2, per_rate)
            Na, Ga, Nb, Gb = by * border[k, a], by * border[3 + k, a], by * border[k, b], by * border[3 + k, b]
        Nb, Gb = Nb - blocks[3, b] * Na, Gb - blocks[4, b] * Na - blocks[5, b] * Ga
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
        schur[k, k] = 1 / schur[k, k]
        for i in range(k + 1, 5):
            schur[i, k] *= schur[k, k]
            for j in range(k + 1, 5):
                schur[i, j] -= schur[i, k] * schur[k, j]
    return u_t, q_a, q_b, zN_a, zN_b, zG_a, zG_b, per_rate, z_N, z_G


@kernel
def back_substitute(r, M, blocks, border, memory_rows, schur, pivot, couplings, b):
    """Solve (shift - J) u = r in place with the factors; b (5,) is work space."""
    N, G = r[:M], r[M : 2 * M]
    a11, a21, a22 = blocks[6], blocks[7], blocks[8]
    n = g = 0.0
    for i in range(M):
        g = G[i] - a21[i] * n - a22[i] * g
        n = N[i] - a11[i] * n
        N[i], G[i] = n, g
    _, q_a, q_b, zN_a, zN_b, zG_a, zG_b, per_rate, z_N, z_G = couplings
    d11, d21, d22, c11, c21, c22 = blocks[0], blocks[1], blocks[2], blocks[3], blocks[4], blocks[5]
    k, m = M - 1, M - 2
    b[0], b[1], b[2], b[3], b[4] = r[2 * M], r[2 * M + 1], r[2 * M + 2], 0.0, 0.0
    if M > 0:
        Na, Ga = d11[k] * N[k], d21[k] * N[k] + d22[k] * G[k]
        Nb, Gb = d11[m] * N[m] - c11[m] * Na, d21[m] * N[m] + d22[m] * G[m] - c21[m] * Na - c22[m] * Ga
        b[3] = q_a * Na + q_b * Nb
        b[4] = zN_a * Na + zN_b * Nb + zG_a * Ga + zG_b * Gb
    for i in range(memory_rows.shape[0]):
        b[1] += memory_rows[i, 0] * memory_rows[i, 3] * r[2 * M + 3 + i]
    for i in range(5):  # rows of the factors were swapped whole, so all exchanges come first
        j = pivot[i]
        b[i], b[j] = b[j], b[i]
    for i in range(5):
        for j in range(i):
            b[i] -= schur[i, j] * b[j]
    for i in range(4, -1, -1):
        for j in range(i + 1, 5):
            b[i] -= schur[i, j] * b[j]
        b[i] *= schur[i, i]
    r[2 * M], r[2 * M + 1], r[2 * M + 2] = b[0], b[1], b[2]
    for i in range(memory_rows.shape[0]):
        r[2 * M + 3 + i] = memory_rows[i, 0] * (r[2 * M + 3 + i] + memory_rows[i, 1] * b[0] + memory_rows[i, 2] * b[1])
    if M == 0:
        return
    by_R, by_P, by_sweep = b[0], b[2], b[1] + per_rate * b[3]
    f0, f1, f2 = border[3], border[4], border[5]
    for i in range(M):
        G[i] = d21[i] * N[i] + d22[i] * G[i] - (f0[i] * by_P + f1[i] * by_R + f2[i] * by_sweep)
    e0, e1, e2 = border[0], border[1], border[2]
    for i in range(M):
        N[i] = d11[i] * N[i] - (e0[i] * by_P + e1[i] * by_R + e2[i] * by_sweep)
    N[k] -= z_N * b[4]
    G[k] -= z_G * b[4]
    n = g = 0.0
    for i in range(M - 1, -1, -1):
        g = G[i] - c21[i] * n - c22[i] * g
        n = N[i] - c11[i] * n
        N[i], G[i] = n, g


@kernel
def add_weighted_sum(x, weights, scale, u, count):
    """x += scale * the weighted sum of the first `count` rows of u, three rows at a time."""
    m = count % 3
    if m == 1:
        a, p = scale * weights[0], u[0]
        for j in range(x.size):
            x[j] += a * p[j]
    elif m == 2:
        a, b, p, q = scale * weights[0], scale * weights[1], u[0], u[1]
        for j in range(x.size):
            x[j] += a * p[j] + b * q[j]
    while m < count:
        a, b, c = scale * weights[m], scale * weights[m + 1], scale * weights[m + 2]
        p, q, r = u[m], u[m + 1], u[m + 2]
        for j in range(x.size):
            x[j] += a * p[j] + b * q[j] + c * r[j]
        m += 3


@kernel
def longest_step(table, t):
    """The longest step from t that skips no piece of the table: to the end of the next piece."""
    return table[min(row_index(table, t) + 2, table.shape[0] - 1), 0] - t


@kernel
def write_row(k, x, h, M, numbers, y, slope, next_y, next_slope, out, fields):
    """Write row k of the results, at a fraction x of the step h from y to next_y."""
    # quintic Hermite in R, whose first two derivatives are known at both ends; cubic in all else
    R0, V0, A0 = y[2 * M], h * y[2 * M + 1], h * h * slope[2 * M + 1]
    D, V1, A1 = next_y[2 * M] - R0, h * next_y[2 * M + 1], h * h * next_slope[2 * M + 1]
    c3 = 10 * D - 6 * V0 - 4 * V1 - 1.5 * A0 + 0.5 * A1
    c4 = -15 * D + 8 * V0 + 7 * V1 + 1.5 * A0 - A1
    c5 = 6 * D - 3 * V0 - 3 * V1 - 0.5 * A0 + 0.5 * A1
    R = R0 + x * (V0 + x * (0.5 * A0 + x * (c3 + x * (c4 + x * c5))))
    U = (V0 + x * (A0 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / h
    i = x * x * (3 - 2 * x)
    s0, s1 = h * x * (1 - x) * (1 - x), h * x * x * (x - 1)
    j = 2 * M + 2
    out[k, 0], out[k, 1] = R, U
    P = y[j] + i * (next_y[j] - y[j]) + s0 * slope[j] + s1 * next_slope[j]
    out[k, 2] = numbers.base + P / (R * R * R)
    out[k, 3] = stress(numbers, R, U / R)[0]
    for m in range(numbers.memory.shape[0]):
        j = 2 * M + 3 + m
        out[k, 4 + m] = y[j] + i * (next_y[j] - y[j]) + s0 * slope[j] + s1 * next_slope[j]
        out[k, 3] += numbers.memory[m, 0] * out[k, 4 + m]
    if fields.size > 0:
        for j in range(2 * M):  # with fields, steps end at the frames
            fields[k, j] = next_y[j]


@kernel
def march(numbers, grid, method, start, time, rtol, max_steps, to_turn, out, fields, stats, work):
    """The work of `integrate`, in the arrays `work` that `integrate` makes."""
    M, K = grid.centre.size, numbers.memory.shape[0]
    A, C, stage_times, time_weights, gamma, order = method
    n, stages = 2 * M + 3 + K, A.shape[0]
    y, next_y, slope, next_slope, u, theta, gas, F, H, cell, flux, blocks, border, memory_rows, schur, b, pivot = work
    R, p = start[0], start[2]
    y[:M], y[M : 2 * M] = p * R**3, (p - numbers.vapour) * R**3
    for j in range(3 + K):
        y[2 * M + j] = start[j]
    y[2 * M + 2] = (p - numbers.base) * R**3
    gas_at_start = (p - numbers.vapour) * R**3
    cause = fault(numbers, R, gas_at_start)
    t, h, after_rejection, status = 0.0, 1e-3 if cause == OK else 0.0, False, OK
    k = steps = rejected = 0
    last_error = last_h = 1.0
    p_dot, z = derivatives(t, y, numbers, grid, theta, gas, F, H, slope)
    while k < time.size and time[k] <= 0.0:
        write_row(k, 0.0, 1.0, M, numbers, y, slope, y, slope, out, fields)
        k += 1
    while k < time.size and not (to_turn and y[2 * M + 1] < 0):
        if steps + rejected >= max_steps:
            status = TOO_MANY_STEPS
            break
        if h < 1e-14 * (1 + t):
            status = OUTSIDE_LAW if cause == OUTSIDE_LAW else STEP_TOO_SMALL
            break
        planned_step = h
        h = min(h, longest_step(numbers.driving, t))
        if fields.size > 0:  # the rates at the wall are stiff: results are accurate only at the ends of steps
            h = min(h, time[k] - t)
        shift = 1 / (h * gamma)
        if M > 0:
            eliminate(y, numbers, grid, p_dot, z, shift, cell, flux, blocks, border)
        couplings = factorise(t, y, numbers, grid, p_dot, z, shift, blocks, border, memory_rows, schur, pivot)
        for s in range(stages):
            v = u[s]
            if s == 0:
                for j in range(n):
                    v[j] = slope[j]
            else:
                if s < stages - 2:
                    for j in range(n):  # an assignment of slices is three times as slow
                        next_y[j] = y[j]
                    add_weighted_sum(next_y, A[s], 1.0, u, s)
                else:  # stiffly accurate: this point is the previous stage's point plus its increment
                    add_weighted_sum(next_y, A[s, s - 1 :], 1.0, u[s - 1 :], 1)
                cause = fault(numbers, next_y[2 * M], next_y[2 * M + 2])
                if cause != OK:
                    break
                derivatives(t + stage_times[s] * h, next_y, numbers, grid, theta, gas, F, H, v)
                add_weighted_sum(v, C[s], 1 / h, u, s)
            v[2 * M + 1] += time_weights[s] * h * couplings[0]
            back_substitute(v, M, blocks, border, memory_rows, schur, pivot, couplings, b)
        error, usable = 0.0, cause == OK
        if usable:
            last = u[stages - 1]
            for j in range(n):
                next_y[j] += last[j]
            for j in range(2 * M):
                usable = usable and next_y[j] > 0
                e = last[j] / next_y[j]
                error += e * e
            error /= max(2 * M, 1)
            e_R, e_P = last[2 * M] / next_y[2 * M], last[2 * M + 2] / next_y[2 * M + 2]
            e_U = last[2 * M + 1] / (1 + abs(next_y[2 * M + 1]))
            error += e_R * e_R + e_U * e_U + e_P * e_P
            for j in range(2 * M + 3, n):  # error of the stress, relative to the ambient pressure or the stress
                modulus = numbers.memory[j - 2 * M - 3, 0]
                e = modulus * last[j] / (1 + abs(modulus * next_y[j]))
                error += e * e
            error = math.sqrt(error / 4) / rtol
            cause = fault(numbers, next_y[2 * M], next_y[2 * M + 2])
            usable = usable and error < 1e10 and cause == OK
        if not usable or error > 1:
            rejected, after_rejection = rejected + 1, True
            h *= max(0.2, 0.9 * error ** (-1 / order)) if usable else 0.2
            continue
        rebounds = y[2 * M + 1] < 0 < next_y[2 * M + 1] and next_y[2 * M] < numbers.damage[2]
        if rebounds and next_y[2 * M + 1] > 1e-3:  # the law changes where the wall turns: end the step there
            rejected += 1
            h *= y[2 * M + 1] / (y[2 * M + 1] - next_y[2 * M + 1])
            continue
        p_dot, z = derivatives(t + h, next_y, numbers, grid, theta, gas, F, H, next_slope)
        end = time[k] if fields.size > 0 and h == time[k] - t else t + h
        while k < time.size and time[k] <= end:
            write_row(k, (time[k] - t) / h, h, M, numbers, y, slope, next_y, next_slope, out, fields)
            k += 1
        t, steps = end, steps + 1
        if rebounds:
            apply_damage(numbers, next_y[2 * M])
            p_dot, z = derivatives(t, next_y, numbers, grid, theta, gas, F, H, next_slope)
        y, next_y = next_y, y
        slope, next_slope = next_slope, slope
        growth = 0.9 * max(error, 1e-8) ** (-1 / order)
        if steps > 1 and h == planned_step:  # Gustafsson's control expects further growth of the error: few rejections
            trend = (max(last_error, 1e-2) / max(error * error, 1e-8)) ** (1 / order)
            growth = min(growth, 0.9 * h / last_h * trend)
        last_error, last_h = error, h
        h = max(h * min(growth, 1.0 if after_rejection else 5.0), planned_step if h < planned_step else 0.0)
        after_rejection = False
    total = 0.0
    for i in range(M):
        total += y[M + i] / grid.inverse_volume[i]
    if M == 0:  # a polytropic gas conserves p_g R^(3 polytropic)
        R = y[2 * M]
        total = y[2 * M + 2] + (numbers.base - numbers.pv) * R**3
        total *= (R / start[0]) ** (3 * numbers.polytropic - 3) / 3
    stats[0], stats[1], stats[2] = steps, rejected, 3 * total / gas_at_start - 1
    stats[3], stats[4] = t, y[2 * M]
    return status


@compiled
def integrate(numbers, grid, method, start, time, rtol, max_steps, to_turn, out, fields, stats):
    """Integrate from the state `start` (3 + k,) R, U, p, m_k, contents at rest and ambient temperature, to time[-1].

    out (time, 4 + k): R, U, p, S, m_k; fields (time, 2 M) or empty: the contents. Rows after a failure are not written;
    if `to_turn`, neither are rows after the first step in which the wall turns from growth to collapse.
    stats (5,): steps, rejected steps, relative change of the gas in the bubble, time reached, radius there.
    Returns OK, TOO_MANY_STEPS, STEP_TOO_SMALL, or OUTSIDE_LAW if no step stays within the laws of the material.
    """
    M, K = grid.centre.size, numbers.memory.shape[0]
    n, stages = 2 * M + 3 + K, method.A.shape[0]
    y, next_y, slope, next_slope = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    theta, gas, F, H = np.empty(M), np.empty(M), np.empty(M + 1), np.empty(M + 1)
    cell, flux, blocks, border = np.zeros((5, M)), np.zeros((7, M + 1)), np.zeros((9, M)), np.zeros((6, M))
    shell_arrays = theta, gas, F, H, cell, flux, blocks, border
    border_arrays = np.zeros((K, 4)), np.zeros((5, 5)), np.zeros(5), np.zeros(5, np.int64)
    work = (y, next_y, slope, next_slope, np.empty((stages, n)), *shell_arrays, *border_arrays)
    return march(numbers, grid, method, start, time, rtol, max_steps, to_turn, out, fields, stats, work)
