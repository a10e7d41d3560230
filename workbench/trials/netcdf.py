"""A Dataset as the bytes of a netCDF-4 file, and back: every number, word and attribute as it was.

Nothing is encoded and nothing decoded: a unit such as ``days`` is a word, and a ``scale_factor`` scales nothing. What
netCDF has no type for is written as whole numbers, with the attribute ``dtype`` that says what they are: truths, and
points and spans of time. The file is made in memory, because HDF5 may crash where a disk is full.
"""

from __future__ import annotations

import io
import os
from collections.abc import Hashable, Mapping, Sequence
from typing import TypeAlias

import h5netcdf
import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from models.quantity import InvalidValue

AnyArray: TypeAlias = NDArray[np.generic]
COORDINATES = "coordinates"
"""The root attribute that names the coordinates that are no axes, with blanks between (xarray reads it too)."""
KIND = "dtype"
COMPRESSED = 10_000
"""Numbers beyond which a variable is compressed."""


def packed(data: xr.Dataset, attributes: Mapping[str, str]) -> bytes:
    """Return a Dataset as a file with these root attributes besides its own.

    Raises InvalidValue, naming the variable, for what such a file cannot hold.
    """
    beside = [str(name) for name in data.coords if name not in data.dims]
    if spaced := [name for name in beside if " " in name]:
        raise InvalidValue(
            f"a coordinate that is no axis must have a name without blanks, got {spaced[0]!r}: rename it"
        )
    file = io.BytesIO()
    with h5netcdf.File(file, "w") as out:
        out.dimensions = {str(name): size for name, size in data.sizes.items()}
        for name, variable in data.variables.items():
            stored, kind = _stored(str(name), variable.values)
            try:
                _write(out, str(name), variable.dims, stored, dict(variable.attrs) | dict(kind))
            except Exception as error:
                raise InvalidValue(f"{name} cannot be written to run.nc: {_first(error)}") from None
        coordinates = {COORDINATES: " ".join(beside)} if beside else {}
        out.attrs.update({**data.attrs, **attributes, **coordinates})
    return file.getvalue()


def unpacked(file: str | os.PathLike[str]) -> xr.Dataset:
    """Return the Dataset that a file holds, all root attributes with it. Raises whatever reading raises."""
    with h5netcdf.File(os.fspath(file), "r", decode_vlen_strings=True) as held:
        variables = {name: _read(variable) for name, variable in held.variables.items()}
        attributes = dict(held.attrs)
    beside = str(attributes.pop(COORDINATES, "")).split()
    at = {name: one for name, one in variables.items() if name in beside or one.dims == (name,)}
    data = xr.Dataset({name: one for name, one in variables.items() if name not in at}, at, attributes)
    return data[list(variables)] if list(data.variables) != list(variables) else data


def _write(
    out: h5netcdf.File, name: str, dims: Sequence[Hashable], values: AnyArray, attributes: Mapping[Hashable, object]
) -> None:
    text = values.dtype.kind == "O"
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.size > COMPRESSED else {}
    made = out.create_variable(
        name, tuple(map(str, dims)), dtype=h5py.string_dtype() if text else values.dtype, **packing
    )
    made[...] = values
    for key, value in attributes.items():
        made.attrs[str(key)] = value


def _stored(name: str, values: AnyArray) -> tuple[AnyArray, dict[str, str]]:
    """Return values as netCDF has them, and the attribute that says what they are where it has no such type."""
    kind = values.dtype.kind
    if kind in "iuf" and values.dtype.itemsize <= 8 and values.dtype != np.float16:
        return values, {}
    if kind == "U" or (kind == "O" and all(isinstance(one, str) for one in values.flat)):
        return values.astype(object), {}
    if kind == "b":
        return values.astype(np.int8), {KIND: "bool"}
    if kind in "mM":
        return values.view(np.int64), {KIND: values.dtype.str[1:]}
    raise InvalidValue(f"{name} must hold numbers, text, times or truths, got {values.dtype}: give another type")


def _read(variable: h5netcdf.Variable) -> xr.Variable:
    """Return a variable as it was: attributes by name, text as NumPy's."""
    values, attributes = np.asarray(variable[...]), dict(variable.attrs)
    if values.dtype.kind == "O":
        values = np.array(values.tolist(), dtype=str).reshape(values.shape)
    kind = str(attributes.get(KIND, ""))
    if values.dtype == np.int8 and kind == "bool":
        values = values.astype(bool)
        del attributes[KIND]
    elif values.dtype == np.int64 and kind[:2] in ("m8", "M8"):
        values = values.view(kind)
        del attributes[KIND]
    return xr.Variable(variable.dimensions, values, attributes)


def _first(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
