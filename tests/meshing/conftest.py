from collections.abc import Iterator

import pytest

from built_parts import gmsh_session


@pytest.fixture
def kernel() -> Iterator[None]:
    with gmsh_session():
        yield
