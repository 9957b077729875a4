"""The benchmark's case by FEniCSx: python fenicsx_case.py CASE.npz -> one line of JSON.

Needs dolfinx 0.5 or later, and nothing of bulgefit. The flat reference is a plane mesh of
quadrilaterals, the unknown a displacement with three components: F = [e1 + u,x  e2 + u,y].
"""

from __future__ import annotations

import json
import sys
import time

import dolfinx
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import NonlinearProblem
from dolfinx.nls.petsc import NewtonSolver
from mpi4py import MPI
from petsc4py import PETSc


def main() -> None:
    """Solve all pressure levels, each from the shape of the one before."""
    case = np.load(sys.argv[1])
    nodes, cells, levels = case["nodes"], case["cells"], case["levels"]
    # corners of a dolfinx quadrilateral come row by row
    plane = ufl.Mesh(ufl.VectorElement("Q", "quadrilateral", 1))
    domain = mesh.create_mesh(MPI.COMM_SELF, cells[:, [0, 1, 3, 2]], nodes, plane)
    space = fem.FunctionSpace(domain, ufl.VectorElement("Q", "quadrilateral", 1, dim=3))
    u, v, du = fem.Function(space), ufl.TestFunction(space), ufl.TrialFunction(space)
    flat = ufl.as_matrix([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    f = flat + ufl.grad(u)
    strain = 0.5 * (f.T * f - ufl.Identity(2))
    d11, d22, d12, d33 = (float(d) for d in case["stiffness"])
    e11, e22, shear = strain[0, 0], strain[1, 1], 2.0 * strain[0, 1]
    stress = ufl.as_matrix(
        [[d11 * e11 + d12 * e22, d33 * shear], [d33 * shear, d12 * e11 + d22 * e22]]
    )
    pressure = fem.Constant(domain, PETSc.ScalarType(0.0))
    normal = ufl.cross(
        ufl.as_vector([f[i, 0] for i in range(3)]), ufl.as_vector([f[i, 1] for i in range(3)])
    )
    dx = ufl.Measure("dx", domain=domain, metadata={"quadrature_degree": 2})
    thickness = float(case["thickness"])
    residual = thickness * ufl.inner(f * stress, ufl.grad(v)) * dx
    residual -= pressure * ufl.inner(normal, v) * dx
    domain.topology.create_connectivity(1, 2)
    rim = fem.locate_dofs_topological(space, 1, mesh.exterior_facet_indices(domain.topology))
    held = fem.dirichletbc(np.zeros(3), rim, space)
    problem = NonlinearProblem(residual, u, bcs=[held], J=ufl.derivative(residual, u, du))
    solver = NewtonSolver(MPI.COMM_SELF, problem)
    solver.convergence_criterion = "incremental"
    solver.rtol, solver.atol, solver.max_it = 1e-6, 1e-6, 50
    krylov = solver.krylov_solver
    krylov.setType("preonly")
    krylov.getPC().setType("lu")
    krylov.getPC().setFactorSolverType(sys.argv[2] if len(sys.argv) > 2 else "petsc")

    x = space.tabulate_dof_coordinates()[:, :2]
    start = time.process_time()
    height, radius = float(case["first_height"]), float(case["radius"])
    u.x.array[2::3] = height * (1.0 - (x**2).sum(axis=1) / radius**2)
    iterations = 0
    for level in levels:
        pressure.value = level
        iterations += solver.solve(u)[0]
    seconds = time.process_time() - start
    apex = int(np.argmin((x**2).sum(axis=1)))
    answer = {
        "version": f"dolfinx {dolfinx.__version__}",
        "seconds": seconds,
        "iterations": iterations,
        "apex_mm": float(u.x.array[3 * apex + 2]),
    }
    print(json.dumps(answer))


main()
