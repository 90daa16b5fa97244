"""Packages of the wheel: the present folders of ``package-dir`` in ``pyproject.toml``, under their import names.

The image of an agent is built without the folder of the simulation, for example.
"""

import tomllib
from pathlib import Path

from setuptools import find_packages, setup

PROJECT = tomllib.loads(Path(__file__).with_name("pyproject.toml").read_text(encoding="utf-8"))
FOLDERS = PROJECT["tool"]["setuptools"]["package-dir"]  # import name: folder

setup(
    packages=[
        name + package.removeprefix(folder)
        for name, folder in FOLDERS.items()
        for package in find_packages(include=(folder, f"{folder}.*"))
    ]
)
