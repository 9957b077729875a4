#!/usr/bin/env bash
# Draws the README's picture: the fit of its main command. Run from anywhere.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
bulgefit fit data/example_bulge.npz --bounds E1=200:500,E2=150:400,G12=10:60 --plots "$folder"
cp "$folder/example_bulge_profiles.png" docs/pictures/
