"""The cell file: settings of the controller, and those of the twin."""

from cell.config.settings import CellSettings
from drivers.twin.settings import TwinSettings


class CellFile(CellSettings):
    """Contents of configs/cell.yaml."""

    twin: TwinSettings

    @property
    def controller(self) -> CellSettings:
        """The settings that the controller may use: all but the twin."""
        return CellSettings.model_validate(self.model_dump(by_alias=True, exclude={"twin"}))
