//! The drawing modules of `web/`, run by an embedded JavaScript engine, and pictures turned into pixels.

use serde_json::{Value, json};

/// The pure modules, in the order of their dependence.
const MODULES: [&str; 7] = [
    include_str!("../../web/draw.js"),
    include_str!("../../web/run.js"),
    include_str!("../../web/terrain.js"),
    include_str!("../../web/arena.js"),
    include_str!("../../web/plot.js"),
    include_str!("../../web/report-body.js"),
    include_str!("../../web/batch.js"),
];
/// Pictures of studies, which no report has in it.
const STUDIES: [&str; 2] = [
    include_str!("../../web/figures.js"),
    include_str!("../../web/crossing.js"),
];
const CROSSING_PLAYER: &str = include_str!("../../web/crossing-player.js");
const PLAYER: &str = include_str!("../../web/report.js");
const STYLE: &str = include_str!("../../web/report.css");
const TEMPLATE: &str = include_str!("../../web/report.html");

/// Most samples that a report's player keeps.
const SAMPLES_MAX: usize = 8000;

/// Why nothing could be drawn.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A script failed: a defect of this program.
    #[error("drawing failed: {0}")]
    Script(String),
    /// An SVG could not be turned into pixels.
    #[error("the picture could not be rendered: {0}")]
    Picture(String),
}

/// The drawing modules, loaded.
pub struct Press {
    _runtime: rquickjs::Runtime,
    context: rquickjs::Context,
}

/// Module text as script: without imports, and with exports as plain declarations.
fn script(module: &str) -> String {
    module
        .lines()
        .filter(|line| !line.starts_with("import "))
        .map(|line| line.strip_prefix("export ").unwrap_or(line))
        .fold(String::with_capacity(module.len()), |mut text, line| {
            text.push_str(line);
            text.push('\n');
            text
        })
}

impl Press {
    /// Starts the engine and loads the modules.
    pub fn new() -> Result<Self, ReportError> {
        let fail = |error: rquickjs::Error| ReportError::Script(error.to_string());
        let runtime = rquickjs::Runtime::new().map_err(fail)?;
        // A drawing of a large run needs some tens of megabytes; nothing should need more than this.
        runtime.set_memory_limit(1 << 30);
        runtime.set_max_stack_size(8 << 20);
        let context = rquickjs::Context::full(&runtime).map_err(fail)?;
        let modules = MODULES.iter().chain(&STUDIES);
        let text: String = modules.map(|module| script(module)).collect();
        context.with(|ctx| ctx.eval::<(), _>(text).map_err(|error| caught(&ctx, error)))?;
        Ok(Press {
            _runtime: runtime,
            context,
        })
    }

    /// Calls a drawing function with JSON arguments.
    fn call(&self, function: &str, arguments: &[&Value]) -> Result<String, ReportError> {
        self.context.with(|ctx| {
            let result = (|| {
                let call: rquickjs::Function<'_> = ctx.globals().get(function)?;
                let mut values = rquickjs::function::Args::new(ctx.clone(), arguments.len());
                for argument in arguments {
                    values.push_arg(ctx.json_parse(argument.to_string())?)?;
                }
                call.call_arg::<String>(values)
            })();
            result.map_err(|error| caught(&ctx, error))
        })
    }

    /// The arena with trails, as a complete SVG document.
    pub fn arena(&self, data: &Value) -> Result<String, ReportError> {
        self.call("renderArena", &[data, &json!({})])
    }

    /// Stacked plots, as a complete SVG document; `specs` as in the data's `plots`.
    pub fn plots(
        &self,
        data: &Value,
        specs: &Value,
        options: &Value,
    ) -> Result<String, ReportError> {
        self.call("renderPlot", &[data, specs, options])
    }

    /// Figures of a study in two columns, as a complete SVG document.
    pub fn figures(&self, data: &Value) -> Result<String, ReportError> {
        self.call("renderFigures", &[data])
    }

    /// How a distance falls with stiffness, as a complete SVG document.
    pub fn convergence(&self, data: &Value) -> Result<String, ReportError> {
        self.call("renderConvergence", &[data])
    }

    /// Maps of the order of waves, as a complete SVG document.
    pub fn orders(&self, data: &Value) -> Result<String, ReportError> {
        self.call("renderOrders", &[data])
    }

    /// The map of strategies on obstacles, as a complete SVG document.
    pub fn strategies(&self, data: &Value) -> Result<String, ReportError> {
        self.call("renderStrategies", &[data])
    }

    /// Instants of a crossing, as a complete SVG document.
    pub fn strip(&self, data: &Value) -> Result<String, ReportError> {
        self.call("renderStrip", &[data])
    }

    /// The self-contained page that plays a crossing.
    pub fn crossing(&self, data: &Value) -> Result<String, ReportError> {
        let title = self.call("crossingTitle", &[data])?;
        let body = self.call("crossingBody", &[data])?;
        let style = self.call("reportStyle", &[])? + &self.call("crossingStyle", &[])?;
        let packed = data.to_string().replace('<', "\\u003c");
        let code = script(MODULES[0]) + &script(STUDIES[1]) + &script(CROSSING_PLAYER);
        Ok(fill(
            TEMPLATE,
            &[
                ("<!--TITLE-->", &title),
                ("<!--BODY-->", &body),
                ("/*CSS*/", &style),
                ("/*DATA*/", &packed),
                ("/*SCRIPT*/", &code),
            ],
        ))
    }

    /// The self-contained page of a batch; without scripts.
    pub fn batch(&self, data: &Value) -> Result<String, ReportError> {
        let title = self.call("batchTitle", &[data])?;
        let body = self.call("batchBody", &[data])?;
        let style = self.call("reportStyle", &[])? + STYLE;
        let page = fill(
            TEMPLATE,
            &[
                ("<!--TITLE-->", &title),
                ("<!--BODY-->", &body),
                ("/*CSS*/", &style),
            ],
        );
        // The template's scripts are the last of its body.
        let start = page.rfind("<script type=\"application/json\"");
        let end = page.rfind("</body>");
        Ok(match (start, end) {
            (Some(start), Some(end)) => page[..start].to_owned() + &page[end..],
            _ => page,
        })
    }

    /// The self-contained page.
    pub fn page(&self, data: &Value) -> Result<String, ReportError> {
        let title = self.call("reportTitle", &[data])?;
        let body = self.call("reportBody", &[data])?;
        let style = self.call("reportStyle", &[])? + STYLE;
        let packed = self.call("reportData", &[data, &json!(SAMPLES_MAX)])?;
        let packed = packed.replace('<', "\\u003c");
        let mut code: String = MODULES.iter().map(|module| script(module)).collect();
        code.push_str(&script(PLAYER));
        Ok(fill(
            TEMPLATE,
            &[
                ("<!--TITLE-->", &title),
                ("<!--BODY-->", &body),
                ("/*CSS*/", &style),
                ("/*DATA*/", &packed),
                ("/*SCRIPT*/", &code),
            ],
        ))
    }
}

/// The message of a JavaScript exception.
fn caught(ctx: &rquickjs::Ctx<'_>, error: rquickjs::Error) -> ReportError {
    let message = match error {
        rquickjs::Error::Exception => ctx
            .catch()
            .as_exception()
            .map_or_else(|| "unknown exception".to_owned(), |e| format!("{e}")),
        other => other.to_string(),
    };
    ReportError::Script(message)
}

/// Replaces each placeholder once, in one pass: what is put in is not searched again.
fn fill(template: &str, values: &[(&str, &String)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    while let Some((at, (mark, value))) = values
        .iter()
        .filter_map(|pair| rest.find(pair.0).map(|at| (at, pair)))
        .min_by_key(|(at, _)| *at)
    {
        page.push_str(&rest[..at]);
        page.push_str(value);
        rest = &rest[at + mark.len()..];
    }
    page.push_str(rest);
    page
}

/// An SVG document as PNG, `scale` pixels per unit, with an embedded font: the same everywhere.
pub fn png(svg: &str, scale: f32) -> Result<Vec<u8>, ReportError> {
    use resvg::{tiny_skia, usvg};
    let fail = |error: String| ReportError::Picture(error);
    let mut options = usvg::Options::default();
    let fonts = options.fontdb_mut();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    options.font_family = "DejaVu Sans".into();
    let tree = usvg::Tree::from_str(svg, &options).map_err(|error| fail(error.to_string()))?;
    let size = tree.size();
    let (width, height) = (
        (size.width() * scale).ceil(),
        (size.height() * scale).ceil(),
    );
    let mut pixmap = tiny_skia::Pixmap::new(width as u32, height as u32)
        .ok_or_else(|| fail(format!("its size of {width} x {height} is out of range")))?;
    resvg::render(
        &tree,
        tiny_skia::Transform::from_scale(scale, scale),
        &mut pixmap.as_mut(),
    );
    pixmap.encode_png().map_err(|error| fail(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The modules become one script, in which a name twice would silently be the later one.
    #[test]
    fn invariant_names_of_modules_differ() {
        let mut names = std::collections::BTreeSet::new();
        let text: String = MODULES.iter().chain(&STUDIES).map(|m| script(m)).collect();
        for line in text.lines() {
            let mut words = line.split([' ', '(']);
            if ["function", "const", "let", "class"].contains(&words.next().unwrap_or_default()) {
                let name = words.next().unwrap_or_default();
                assert!(names.insert(name.to_owned()), "{name} is there twice");
            }
        }
        assert!(names.len() > 100, "declarations were found");
    }
}
