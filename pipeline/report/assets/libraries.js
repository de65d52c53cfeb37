import { init, use } from "echarts/core";
import { ParallelChart, ScatterChart } from "echarts/charts";
import { ParallelComponent, GridComponent, TooltipComponent, BrushComponent, AriaComponent } from "echarts/components";
import { CanvasRenderer } from "echarts/renderers";
import { Tabulator, SortModule, FilterModule, FormatModule, FrozenColumnsModule, InteractionModule, ResizeColumnsModule, EditModule, AccessorModule } from "tabulator-tables";

use([ParallelChart, ScatterChart, ParallelComponent, GridComponent, TooltipComponent, BrushComponent, AriaComponent, CanvasRenderer]);
Tabulator.registerModule([SortModule, FilterModule, FormatModule, FrozenColumnsModule, InteractionModule, ResizeColumnsModule, EditModule, AccessorModule]);
export { init, Tabulator };
