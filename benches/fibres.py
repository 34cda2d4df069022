#!/usr/bin/env python3
"""Prints a table of the fibres of the measured muscles, with and without aponeuroses, beside a table of architecture.

    python3 benches/fibres.py                  all muscles: about 20 seconds
    python3 benches/fibres.py iliacus soleus   only muscles whose name contains one of these

The data are those of PLIANT_DATA, otherwise ../shared/data; without them it says "skipped". Areas are the measured patches where there is
one, otherwise all of the muscle near a bone, or its upper or lower end where the data lack the bone. Lengths are medians in mm, with the
ratio to the optimal length of the table; cross-sections are in cm2. Needs the release build of `pliant`. Standard library only.
"""

import json
import math
import pathlib
import subprocess
import sys
import tempfile

from measured_data import DATA, PROGRAM, is_named, is_ready, parser

RAJAGOPAL = "rajagopal2016_muscle_architecture.csv"
GAIT = "gait2392_muscle_architecture.csv"
# Muscle: areas of origin and insertion, and the rows of the table. An area is a patch (file and component), a bone with a distance in mm,
# or the part of the muscle's height, from above or below, that its end takes, without what is nearer to a bone than a distance in mm.
MUSCLES = {
    "Gluteus_maximus_muscle": (("gluteus_maximus", 1), ("gluteus_maximus", 0), RAJAGOPAL, "glmax1_r,glmax2_r,glmax3_r"),
    "Gluteus_medius_muscle": (("gluteus_medius", 0), ("gluteus_medius", 1), RAJAGOPAL, "glmed1_r,glmed2_r,glmed3_r"),
    "Iliacus_muscle": (("iliacus", 0), ("near", "Femur.r", 4), RAJAGOPAL, "iliacus_r"),
    "Psoas_major": (("above", 0.25), ("near", "Femur.r", 6), RAJAGOPAL, "psoas_r"),
    "Rectus_femoris": (("near", "Hip_bone.r", 6), ("below", 0.03), RAJAGOPAL, "recfem_r"),
    "Semimembranosus_muscle": (("near", "Hip_bone.r", 8), ("below", 0.03), RAJAGOPAL, "semimem_r"),
    "Gracilis_muscle": (("gracilis", 0), ("gracilis", 1), RAJAGOPAL, "grac_r"),
    "Pectineus_muscle": (("pectineus", 0), ("pectineus", 1), GAIT, "pect_r"),
    "Adductor_magnus": (("near", "Hip_bone.r", 4), ("near", "Femur.r", 2), RAJAGOPAL, "addmagDist_r,addmagIsch_r,addmagMid_r,addmagProx_r"),
    "Long_head_of_biceps_femoris": (("long_head_of_biceps_femoris", 0), ("below", 0.03), RAJAGOPAL, "bflh_r"),
    "Vastus_lateralis_muscle": (("vastus_lateralis", 0), ("below", 0.04), RAJAGOPAL, "vaslat_r"),
    "Vastus_intermedius_muscle": (("vastus_intermedius", 0), ("below", 0.04, "Femur.r", 12), RAJAGOPAL, "vasint_r"),
    "Vastus_medialis_muscle": (("vastus_medialis", 0), ("below", 0.04, "Femur.r", 20), RAJAGOPAL, "vasmed_r"),
    "Soleus_muscle": (("near", "Fibula.r", 4), ("below", 0.04), RAJAGOPAL, "soleus_r"),
    "Medial_head_of_gastrocnemius": (("above", 0.04), ("below", 0.03), RAJAGOPAL, "gasmed_r"),
}


def vertices(path):
    return [tuple(map(float, line.split()[1:4])) for line in path.open() if line.startswith("v ")]


def bone(name):
    return DATA / "body" / "bones" / f"{name}.obj"


def area(kind, muscle):
    name = kind[0]
    if name == "near":
        return f"near:{bone(kind[1])},{kind[2]}mm"
    if name in ("above", "below"):
        x = vertices(muscle)
        low, high = (of(p[1] for p in x) for of in (min, max))
        share = kind[1] * (high - low)
        taken = [v for v, p in enumerate(x) if (p[1] >= high - share if name == "above" else p[1] <= low + share)]
        if len(kind) > 2:
            near = vertices(bone(kind[2]))
            taken = [v for v in taken if all(math.dist(x[v], p) > kind[3] / 1e3 for p in near)]
        return f"[{','.join(map(str, taken))}]"
    return f"{DATA / 'body' / 'attachments' / name}.obj#{kind[1]}"


def run(folder, muscle, kinds, table, plates):
    areas = [area(kind, muscle) for kind in kinds]
    command = [PROGRAM, "fibres", muscle, "--unit", "m", "--origin", areas[0], "--insertion", areas[1], "--architecture",
               f"{DATA / 'tables' / table[0]}#{table[1]}", "--out", folder / muscle.stem, "--json", *plates]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"{muscle.stem}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def cells(summary):
    fibres = summary["fibres"]
    length = f"{1e3 * fibres['length_median_m']:.0f}, {fibres['optimal_length_ratio']:.2f}"
    wrong = sum(not verdict["passed"] for verdict in summary["verdicts"])
    return length, f"{fibres['coverage']:.3f}", f"{fibres['tilt_at_ends_deg_median']:.0f}", fibres, wrong


def main():
    options = parser(__doc__).parse_args()
    if not is_ready():
        return
    print("| muscle | without | coverage, tilt, red | `auto` | coverage, tilt, red | pennation | cross-section |")
    print("|---" * 7 + "|")
    near = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, (origin, insertion, *table) in MUSCLES.items():
            if not is_named(name, options.names):
                continue
            muscle = DATA / "body" / "muscles" / f"{name}.r.obj"
            both = [cells(run(pathlib.Path(folder), muscle, (origin, insertion), table, plates))
                    for plates in ([], ["--aponeurosis", "auto"])]
            (without, *first, plain, red), (auto, *second, plated, red_auto) = both
            near += abs(plated["optimal_length_ratio"] - 1.0) <= 0.35
            section = ", ".join(f"{1e4 * f['cross_section_m2']:.1f}" for f in (plain, plated))
            row = [name, without, ", ".join(first + [str(red)]), auto, ", ".join(second + [str(red_auto)]),
                   f"{plated['pennation_mean_deg']:.0f}", section]
            print("| " + " | ".join(row) + " |", flush=True)
    print(f"\n{near} muscles with plates lie within 35 % of the table.")


if __name__ == "__main__":
    main()
