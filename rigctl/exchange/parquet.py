"""The table of a store as a Parquet file; the extra `files`.

Every field has `units` among its metadata where they are known, and `uncertainty`, the name of the
field with the standard uncertainties in the same unit. The file's own metadata are the store's title, experiment and
start, and its header as JSON.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl.campaign.recording import Header
from rigctl.campaign.store.header_json import header_to_json
from rigctl.core.extra import FILES, needed
from rigctl.core.whole_file import whole_file
from rigctl.exchange.store_table import StoreTable, uncertainty_names


def write_parquet(table: StoreTable, header: Header, path: Path) -> None:
    """Write a store's table to a new file; `ConfigError` without pyarrow, `DataError` as `whole_file`."""
    arrow, parquet = needed("pyarrow", FILES), needed("pyarrow.parquet", FILES)
    columns = {column.name: column for column in table.columns}
    of_u = uncertainty_names(columns)
    fields, arrays = [], []
    for name, column in columns.items():
        told = {"units": column.unit, "uncertainty": of_u.get(name, "")}
        arrays.append(_array(arrow, column.values))
        fields.append(_field(arrow, name, arrays[-1], told))
        if column.u is not None and not column.u_name:
            arrays.append(_array(arrow, column.u))
            told = {"units": column.unit, "long_name": f"standard uncertainty of {name}"}
            fields.append(_field(arrow, of_u[name], arrays[-1], told))
    about = {
        "title": header.title,
        "experiment": header.experiment,
        "started": header.started,
        "header": header_to_json(header),
    }
    with whole_file(path) as partial:
        parquet.write_table(arrow.table(arrays, schema=arrow.schema(fields, metadata=about)), partial)


def _array(arrow: Any, values: Any) -> Any:
    """Nothing where there is NaN: a frame that is read has NaN there again, a database its NULL."""
    kind = arrow.string() if isinstance(values, list) else None
    return arrow.array(values, type=kind, from_pandas=True)


def _field(arrow: Any, name: str, array: Any, told: dict[str, str]) -> Any:
    return arrow.field(name, array.type, metadata={key: text for key, text in told.items() if text})
