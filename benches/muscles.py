#!/usr/bin/env python3
"""Runs each muscle of the measured data alone with its bones through 60 degrees of a joint, with default settings, and prints a table.

    python3 benches/muscles.py                  each mesh remeshed as `pliant run --muscles` does: about ten minutes on 2 cores
    python3 benches/muscles.py --given          each mesh as given: about ten minutes
    python3 benches/muscles.py iliacus psoas    only meshes whose name contains one of these
    python3 benches/muscles.py --keep FOLDER    keeps the scenes and their summaries

The data are those of PLIANT_DATA, otherwise ../shared/data; without them it says "skipped". Each muscle has tone and fascia, moves for 100
frames, back for 100, and rests for 100. Steps are not named, so that they follow from the motion.

The joints are stand-ins: a joint turns about the x axis (to the left of the body) through the middle of the end of a bone. Where the data
lack a bone, the end of the muscle that it would hold is held by a stand-in bone, a tetrahedron far from everything, which rests or moves with
the joint. Needs the release build of `pliant`. Standard library only.
"""

import csv
import json
import math
import pathlib
import statistics
import subprocess
import tempfile

from measured_data import DATA, PROGRAM, is_named, is_ready, parser

BODY = DATA / "body"

# Joint: bone and end (the least or the greatest height) whose middle is the centre; sign of the turn about x; bones that move.
JOINTS = {
    "hip": ("Femur", max, -1, ["Femur", "Patella", "Tibia", "Fibula"]),
    "knee": ("Femur", min, 1, ["Patella", "Tibia", "Fibula"]),
    "ankle": ("Tibia", min, 1, []),
    "shoulder": ("Humerus", max, -1, ["Humerus", "Radius", "Ulna"]),
    "elbow": ("Humerus", min, -1, ["Radius", "Ulna"]),
}
# Range of a joint that is smaller than 60 degrees.
LESS = {"ankle": 50}
# All bones that are near in a scene of a joint.
AROUND = {
    "hip": ["Hip_bone", "Femur"],
    "knee": ["Hip_bone", "Femur", "Patella", "Tibia"],
    "ankle": ["Femur", "Tibia", "Fibula"],
    "shoulder": ["Scapula", "Humerus"],
    "elbow": ["Scapula", "Humerus", "Radius", "Ulna"],
}
# Muscle: joint, bones with the distance that their attachment reaches [mm], end without a bone. Distances beyond 3 mm are those of
# meshes that lack their tendon.
MUSCLES = {
    "Adductor_magnus": ("hip", {"Hip_bone": 3, "Femur": 3}, None),
    "Brachialis_muscle": ("elbow", {"Humerus": 3, "Ulna": 3}, None),
    "Gluteus_maximus_muscle": ("hip", {"Hip_bone": 3, "Sacrum": 4, "Femur": 3}, None),
    "Gluteus_medius_muscle": ("hip", {"Hip_bone": 3, "Femur": 3}, None),
    "Gracilis_muscle": ("hip", {"Hip_bone": 3, "Tibia": 5}, None),
    "Iliacus_muscle": ("hip", {"Hip_bone": 3, "Femur": 3}, None),
    "Infraspinatus_muscle": ("shoulder", {"Scapula": 3, "Humerus": 3}, None),
    "Long_head_of_biceps_brachii": ("elbow", {"Scapula": 3, "Radius": 31}, None),
    "Long_head_of_biceps_femoris": ("hip", {"Hip_bone": 14, "Fibula": 20}, None),
    "Medial_head_of_gastrocnemius": ("ankle", {"Femur": 3}, min),
    "Pectineus_muscle": ("hip", {"Hip_bone": 3, "Femur": 3}, None),
    "Psoas_major": ("hip", {"Femur": 3}, max),
    "Rectus_femoris": ("knee", {"Hip_bone": 3, "Patella": 30}, None),
    "Semimembranosus_muscle": ("hip", {"Hip_bone": 3, "Tibia": 20}, None),
    "Short_head_of_biceps_brachii": ("elbow", {"Scapula": 3, "Radius": 32}, None),
    "Soleus_muscle": ("ankle", {"Tibia": 3, "Fibula": 3}, min),
    "Subscapularis_muscle": ("shoulder", {"Scapula": 3, "Humerus": 3}, None),
    "Vastus_intermedius_muscle": ("knee", {"Femur": 3, "Patella": 45}, None),
    "Vastus_lateralis_muscle": ("knee", {"Femur": 3, "Patella": 40}, None),
    "Vastus_medialis_muscle": ("knee", {"Femur": 3, "Patella": 38}, None),
}
# The fine meshes have tendons.
FINE = {
    "gluteus_maximus": ("hip", {"Hip_bone": 3, "Sacrum": 3, "Femur": 3}, None),
    "gluteus_medius": ("hip", {"Hip_bone": 3, "Femur": 3}, None),
    "iliacus": ("hip", {"Hip_bone": 3, "Femur": 3}, None),
    "psoas_major": ("hip", {"Femur": 3}, max),
    "rectus_femoris": ("knee", {"Hip_bone": 3, "Patella": 3}, None),
    "semimembranosus": ("hip", {"Hip_bone": 3, "Tibia": 3}, None),
}
# Checks in short.
SHORT = {
    "all numbers are finite": "stopped",
    "frames that did not converge": "",
    "relative volume error": "volume",
    "greatest strain of an edge": "strain",
    "vertices deeper than 0.01 mm in a bone": "vertices in bone",
    "bone vertices inside the muscle": "bone in muscle",
    "crossings of a soft and a rigid surface, most in a frame": "crosses bone",
    "crossings of a surface with itself, most in a frame": "crosses itself",
    "pairs that were not kept in order, over all steps": "order of pairs",
    "distance from the start at the end, relative to the length": "distance at the end",
    "edge stretch at the end, RMS": "strain at the end",
    "motion that parted overlapping surfaces at the start, RMS": "parted far",
    "share of an attachment that the motion would carry into another bone": "attachment",
    "jitter while bones move steadily": "jitter",
    "greatest speed, relative to the attachments": "snap",
    "lift-off from bones": "lift-off",
    "least thickness, relative to that at rest": "thickness",
    "greatest angle of a fold": "fold",
}
# Share of the vertices that all bones together hold, the most for a muscle.
LIMIT = 0.1
# A run that takes longer than this is stopped [s].
LONGEST = 300
# The end of a bone is within this distance of its tip [m].
END = 0.04


# Number of vertices after remeshing.
REMESHED = 2500


def even_edge(vertices, triangles):
    """Length [mm] of the edges of as many equilateral triangles."""
    area = 0.0
    for corners in triangles:
        a, b, c = (vertices[k] for k in corners)
        (ux, uy, uz), (vx, vy, vz) = ([q - p for p, q in zip(a, end)] for end in (b, c))
        area += 0.5 * math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
    return 1e3 * math.sqrt(2 * area / (3**0.5 * REMESHED))


def bone_file(bone):
    name = f"{bone}.obj" if bone == "Sacrum" else f"{bone}.r.obj"
    return BODY / "bones" / name


def mesh(path):
    """Vertices [m] and triangles of an OBJ file."""
    vertices, triangles = [], []
    for line in path.read_text().splitlines():
        if line.startswith("v "):
            vertices.append(tuple(map(float, line.split()[1:4])))
        elif line.startswith("f "):
            triangles.append(tuple(int(corner.split("/")[0]) - 1 for corner in line.split()[1:4]))
    return vertices, triangles


def write(path, vertices, triangles):
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    path.write_text("\n".join(lines) + "\n")


def centre(joint):
    """The middle of the end of the bone of a joint [m]."""
    bone, end, _, _ = JOINTS[joint]
    vertices, _ = mesh(bone_file(bone))
    tip = end(vertices, key=lambda v: v[1])
    near = [v for v in vertices if sum((a - b) ** 2 for a, b in zip(v, tip)) < END**2]
    return [statistics.fmean(v[k] for v in near) for k in range(3)]


def motion(joint):
    _, _, sign, _ = JOINTS[joint]
    at = ", ".join(f'"{c:.6f} m"' for c in centre(joint))
    angle = LESS.get(joint, 60)
    return (
        f'[bone.motion]\njoint = "{joint}"\ncentre = [{at}]\naxis = [{sign}, 0, 0]\n'
        f'keys = [{{ frame = 0, angle = "0 deg" }}, {{ frame = 100, angle = "{angle} deg" }}, {{ frame = 200, angle = "0 deg" }}]\n'
    )


def bone(name, path, moved):
    return f'\n[[bone]]\nname = "{name}"\nmesh = "{path}"\nunit = "m"\n{moved}'


def attachment(name, area, limit):
    return f'[[muscle.attachment]]\nbone = "{name}"\n{area}\nlimit = "{100 * limit:.3f} %"\n'


def stand_in(folder, name, path, end, limit):
    """A patch over the end of a muscle, and a bone that holds it; returns the text of both."""
    vertices, triangles = mesh(path)
    count = max(8, int(limit * len(vertices)))
    order = sorted(range(len(vertices)), key=lambda v: vertices[v][1], reverse=end is max)
    chosen = set(order[:count])
    patch = [t for t in triangles if all(v in chosen for v in t)]
    write(folder / f"{name}-patch.obj", vertices, patch)
    # Half a metre beside and in front of the body.
    far = [(0.5 + 0.002 * x, 0.002 * y, 0.5 + 0.002 * z) for x, y, z in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]]
    write(folder / f"{name}-bone.obj", far, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])
    return f'patch = "{name}-patch.obj"\nunit = "m"\nwithin = "2 mm"'


def scene(folder, name, path, kind, edge):
    joint, held, open_end = kind
    moving = JOINTS[joint][3]
    text = f'name = "{name}"\nframes = 300\nframe_rate = "60 Hz"\n'
    for b in dict.fromkeys([*held, *AROUND[joint]]):
        text += bone(b, bone_file(b), motion(joint) if b in moving else "")
    limit = LIMIT / (len(held) + (open_end is not None))
    area = stand_in(folder, name, path, open_end, limit) if open_end else None
    if area:
        text += bone("stand-in", f"{name}-bone.obj", motion(joint) if open_end is min else "")
    text += f'\n[[muscle]]\nname = "{name}"\nmesh = "{path}"\nunit = "m"\nrepair = true\nclose_holes = 60\n'
    text += f'edge_length = "{edge:.3f} mm"\n' if edge else ""
    for b, near in held.items():
        text += attachment(b, f'near = "{near} mm"', limit)
    text += attachment("stand-in", area, limit) if area else ""
    text += '[muscle.fibres]\nmethod = "harmonic"\n'
    text += '\n[effects.stretch]\n[effects.bending]\nlimit = "50 deg"\n[effects.volume]\n[effects.tone]\n[effects.contact]\nthickness = "0.5 mm"\n'
    text += '[effects.fascia]\n[effects.damping]\nrate = "100 1/s"\n[solver.xpbd]\n'
    file = folder / f"{name}.toml"
    file.write_text(text)
    return file


def run(folder, name, path, kind, edge):
    """Cells of a row: vertices, end, share of contact, slowest frame over the median, time, measures, what failed."""
    out = folder / f"{name}-{'remeshed' if edge else 'given'}"
    command = [PROGRAM, "run", scene(folder, name, path, kind, edge), "--out", out, "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return ["", f"stopped after {LONGEST} s"] + [""] * 6 + ["-"]
    if done.returncode == 2:
        reason = done.stderr.strip().splitlines()[-1].split("error[")[-1]
        return ["", f"refused: {reason[:5].rstrip(']')}"] + [""] * 6 + ["-"]
    summary = json.loads((out / "summary.json").read_text())
    muscle = summary["muscles"]["muscles"][0]
    with open(out / "times.csv", newline="") as times:
        # A run that stops in its first frame has no time.
        frames = [float(row["step_s"]) for row in csv.DictReader(times)] or [0.0]
    effects = summary["times"]["effects_s"]
    contact = effects.get("contact", 0.0) / max(sum(effects.values()), 1e-9)
    failed = [SHORT.get(v["name"], v["name"]) for v in summary["verdicts"] if not v["passed"]]
    end = f"frame {summary['frames']}" if summary["stopped"] or summary["frames"] < 300 else "300"
    end += "" if summary["converged"] else f", {muscle['frames_not_converged']} not converged"
    for file in (out / "frames").glob("*"):
        file.unlink()
    return [
        f"{muscle['vertices']}",
        end,
        f"{summary['audit']['crossings_total']['all']}",
        f"{muscle['edge_stretch_max']:.2f}",
        f"{muscle['quality']['snap_ratio'] or 0:.2f}",
        f"{100 * contact:.0f} %",
        f"{max(frames) / max(statistics.median(frames), 1e-9):.1f}",
        f"{sum(frames):.0f} s",
        "; ".join(filter(None, failed)) or "-",
    ]


def main():
    arguments = parser(__doc__)
    arguments.add_argument("--keep", type=pathlib.Path)
    arguments.add_argument("--given", action="store_true")
    options = arguments.parse_args()
    if not is_ready():
        return
    meshes = [(name, BODY / "muscles" / f"{name}.r.obj", kind) for name, kind in MUSCLES.items()]
    meshes += [(f"fine {name}", BODY / "muscles-fine" / f"{name}.obj", kind) for name, kind in FINE.items()]
    wanted = [m for m in meshes if is_named(m[0], options.names)]
    print("| mesh | joint | stand-in end | edges | vertices | frames | crossings | strain | snap | contact | slowest frame | time | fails |")
    print("|---" * 13 + "|")
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name, path, kind in wanted:
            joint, _, end = kind
            missing = {None: "-", min: "lower", max: "upper"}[end]
            edge = None if options.given else even_edge(*mesh(path))
            cells = run(folder, name.replace(" ", "_"), path, kind, edge)
            first = [name.replace("_", " "), joint, missing, f"{edge:.1f} mm" if edge else "as given"]
            print("| " + " | ".join(first + cells) + " |", flush=True)


if __name__ == "__main__":
    main()
