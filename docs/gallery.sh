#!/usr/bin/env bash
# Makes the pictures of docs/gallery.md anew, with the command `pliant` in PATH or in PLIANT. About three minutes on two cores.
# The animation of a measured hip needs PLIANT_DATA; without it the present one stays.
set -euo pipefail
cd "$(dirname "$0")/.."
pliant="${PLIANT:-pliant}"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
mkdir -p docs/gallery

# Runs a command and keeps one of its pictures. Exit code 1, a failed check, is no reason to keep no picture.
picture() {
    local name="$1" file="$2"
    shift 2
    "$pliant" "$@" --quiet --out "$work/$name" > /dev/null 2>&1 || [ $? -eq 1 ]
    cp "$work/$name/$file" "docs/gallery/$name.${file##*.}"
    echo "docs/gallery/$name.${file##*.}: $(du -k "docs/gallery/$name.${file##*.}" | cut -f1) KB"
}

"$pliant" data "$work/muscle" > /dev/null
"$pliant" data "$work/head" --example skin > /dev/null
"$pliant" data "$work/bodies" --example bodies > /dev/null
picture hip worst.png run hip
cp docs/gallery/hip.png docs/hip.png
picture expander stretch.png implant "$work/head/scalp.obj" --unit m --at 0,0,0.09 --base 6cm --volume 30cc --obstacle "$work/head/skull.obj"
cp "$work/expander/side.png" docs/gallery/expander-section.png
picture fibres broad.png fibres "$work/muscle/Gluteus_medius.r.obj" --unit m --origin "near:$work/muscle/Hip_bone.r.obj,3mm" \
    --insertion "near:$work/muscle/Femur.r.obj,3mm"
picture morph sheet.png morph "$work/bodies/ball.obj" "$work/bodies/pear.obj" --unit cm
picture jelly worst.png run jelly
picture press worst.png run press
picture biceps biceps.gif biceps examples/biceps.toml --animate
if [ -n "${PLIANT_DATA:-}" ]; then
    "$pliant" run examples/right-hip-gluteus-maximus.toml --animate gif --quiet --out "$work/right-hip" > /dev/null 2>&1 || [ $? -eq 1 ]
    cp "$work/right-hip/"*.gif docs/right-hip.gif
    echo "docs/right-hip.gif: $(du -k docs/right-hip.gif | cut -f1) KB"
fi
