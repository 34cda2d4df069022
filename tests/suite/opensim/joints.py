"""A model with a joint and a function of each kind, on oblique frames.

python3 tests/suite/opensim/joints.py > tests/suite/opensim/joints.osim
"""

KINDS = {"Ball": 3, "Gimbal": 3, "Free": 6, "Slider": 1, "Planar": 3, "Weld": 0, "Pin": 1, "Universal": 2, "Custom": 3}


def offset(name, body, k):
    place = f"{0.1 + 0.01 * k:.4g} {-0.2 + 0.03 * k:.4g} {0.05 * k:.4g}"
    turn = f"{0.3 - 0.1 * k:.4g} {0.2 * k:.4g} {-0.4 + 0.05 * k:.4g}"
    socket = "/ground" if body == "ground" else f"/bodyset/{body}"
    return (
        f'<PhysicalOffsetFrame name="{name}"><socket_parent>{socket}</socket_parent>'
        f"<translation>{place}</translation><orientation>{turn}</orientation></PhysicalOffsetFrame>"
    )


def spline(x, y):
    return f"<SimmSpline><x>{x}</x><y>{y}</y></SimmSpline>"


AXES = [
    ("rotation1", "p", "1 2 0.5", "<LinearFunction><coefficients>0.8 0.1</coefficients></LinearFunction>"),
    ("rotation2", "q", "0 2 1", spline("-2 -0.5 0.3 1 1.1", "-1 0.2 0.5 0.4 -0.3")),
    (
        "rotation3",
        "r",
        "-1 0.2 2",
        "<MultiplierFunction><function><LinearFunction><coefficients>1 0.2</coefficients></LinearFunction></function>"
        "<scale>-0.5</scale></MultiplierFunction>",
    ),
    ("translation1", "p", "2 0 0", spline("-1 1", "0.1 0.3")),
    ("translation2", "q", "0 1 1", "<PiecewiseLinearFunction><x>-1 0 0.7</x><y>0 0.2 -0.1</y></PiecewiseLinearFunction>"),
    ("translation3", "r", "0.3 0 1", "<PolynomialFunction><coefficients>0.3 -0.2 0.1</coefficients></PolynomialFunction>"),
]


def main():
    bodies, joints, parent = [], [], "ground"
    for k, (kind, count) in enumerate(KINDS.items()):
        body = kind.lower()
        bodies.append(f'<Body name="{body}"><mass>1</mass><inertia>1 1 1 0 0 0</inertia></Body>')
        names = ["p", "q", "r"] if kind == "Custom" else [f"{body}_{c}" for c in range(count)]
        coordinates = "".join(
            f'<Coordinate name="{name}"><default_value>0</default_value><range>-1.9 1.9</range></Coordinate>' for name in names
        )
        transform = ""
        if kind == "Custom":
            axes = "".join(
                f'<TransformAxis name="{name}"><coordinates>{of}</coordinates><axis>{axis}</axis>{function}</TransformAxis>'
                for name, of, axis, function in AXES
            )
            transform = f"<SpatialTransform>{axes}</SpatialTransform>"
        joints.append(
            f'<{kind}Joint name="{kind}"><socket_parent_frame>on_parent</socket_parent_frame>'
            f"<socket_child_frame>on_child</socket_child_frame><coordinates>{coordinates}</coordinates>"
            f"<frames>{offset('on_parent', parent, k)}{offset('on_child', body, k + 3)}</frames>{transform}</{kind}Joint>"
        )
        parent = body
    coupler = (
        '<CoordinateCouplerConstraint name="coupler"><isEnforced>true</isEnforced><coupled_coordinates_function>'
        + spline("-2 -1 0.4 2", "0.5 0.1 0.3 1")
        + "</coupled_coordinates_function><independent_coordinate_names>p</independent_coordinate_names>"
        "<dependent_coordinate_name>r</dependent_coordinate_name><scale_factor>1.5</scale_factor></CoordinateCouplerConstraint>"
    )
    lines = ['<?xml version="1.0" encoding="UTF-8" ?>', '<OpenSimDocument Version="40600">', '<Model name="joints">']
    lines += ['<BodySet name="bodyset"><objects>', *bodies, "</objects></BodySet>"]
    lines += ['<JointSet name="jointset"><objects>', *joints, "</objects></JointSet>"]
    lines += ['<ConstraintSet name="constraintset"><objects>', coupler, "</objects></ConstraintSet>"]
    lines += ["</Model>", "</OpenSimDocument>"]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
