"""Places of bodies by OpenSim itself.

python3 tests/suite/opensim/oracle.py MODEL.osim COUNT > PLACES.csv

Each row is a pose. Coordinate k of the file has in pose i the value low + (high - low) u, where u is
the fraction of (i + 1) (k + 1) 0.6180339887498949, and low and high are its range within -2 to 2.
Coupled coordinates have the values of their functions. A row has, for each body in the order of the
file, the place in the ground of the point (0.1, 0.2, 0.3) of the body [m].
"""

import math
import sys

import opensim

GOLDEN = 0.6180339887498949


def scale(coupler):
    """The scale factor, for which the bindings have no getter."""
    return float(coupler.getPropertyByName("scale_factor").toString())


def main(path, count):
    opensim.Logger.setLevelString("Off")
    model = opensim.Model(path)
    state = model.initSystem()
    joints = [model.getJointSet().get(k) for k in range(model.getJointSet().getSize())]
    coordinates = [j.get_coordinates(k) for j in joints for k in range(j.numCoordinates())]
    couplers = []
    constraints = model.getConstraintSet()
    for k in range(constraints.getSize()):
        coupler = opensim.CoordinateCouplerConstraint.safeDownCast(constraints.get(k))
        if coupler is not None and coupler.get_isEnforced():
            names = coupler.getIndependentCoordinateNames()
            names = [names.get(n) for n in range(names.getSize())]
            couplers.append((coupler.getDependentCoordinateName(), names, coupler))
    point = opensim.Vec3(0.1, 0.2, 0.3)
    for i in range(count):
        values = {}
        for k, coordinate in enumerate(coordinates):
            low = max(coordinate.getRangeMin(), -2.0)
            high = min(coordinate.getRangeMax(), 2.0)
            share = math.fmod((i + 1) * (k + 1) * GOLDEN, 1.0)
            values[coordinate.getName()] = low + (high - low) * share
        for dependent, names, coupler in couplers:
            arguments = opensim.Vector(len(names), 0.0)
            for n, name in enumerate(names):
                arguments.set(n, values[name])
            values[dependent] = scale(coupler) * coupler.getFunction().calcValue(arguments)
        for coordinate in coordinates:
            coordinate.setLocked(state, False)
            coordinate.setValue(state, values[coordinate.getName()], False)
        model.realizePosition(state)
        row = []
        for b in range(model.getBodySet().getSize()):
            place = model.getBodySet().get(b).findStationLocationInGround(state, point)
            row += [repr(place.get(n)) for n in range(3)]
        print(",".join(row))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
