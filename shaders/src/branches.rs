//! Finds branches that are taken by uniform values alone: `shared.wgsl` says what they cost.

use std::collections::HashMap;

use naga::{
    AddressSpace, Block, Expression, Function, Handle, LocalVariable, Module, Span, Statement,
};

/// What a value differs with, the least first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Varies {
    /// Known when the pipeline is made.
    Never,
    /// With the draw.
    ByDraw,
    /// Between the invocations of a draw.
    Within,
}

/// One function as it is called with arguments that vary in this way.
struct Walk<'m> {
    module: &'m Module,
    function: &'m Function,
    arguments: Vec<Varies>,
    locals: HashMap<Handle<LocalVariable>, Varies>,
    calls: HashMap<Handle<Expression>, Varies>,
    result: Varies,
    found: Vec<Span>,
}

/// Places of branches, in any entry point or what it calls, whose condition is the same for a whole draw and
/// not known before.
pub(crate) fn uniform_branches(module: &Module) -> Vec<Span> {
    let mut found = Vec::new();
    for entry in &module.entry_points {
        let arguments = vec![Varies::Within; entry.function.arguments.len()];
        found.extend(walk(module, &entry.function, arguments).1);
    }
    found.sort_by_key(|place| place.to_range().map(|range| (range.start, range.end)));
    found.dedup();
    found
}

/// How a function's result varies, and its branches.
fn walk(module: &Module, function: &Function, arguments: Vec<Varies>) -> (Varies, Vec<Span>) {
    let (locals, calls) = (HashMap::new(), HashMap::new());
    let (result, found) = (Varies::Never, Vec::new());
    let mut walk = Walk { module, function, arguments, locals, calls, result, found };
    // What is stored late in a loop's body is read early in it; nothing ever varies less than before.
    loop {
        let before = walk.locals.clone();
        walk.found.clear();
        walk.block(&function.body, Varies::Never);
        if walk.locals == before {
            return (walk.result, walk.found);
        }
    }
}

impl Walk<'_> {
    fn value(&self, handle: Handle<Expression>) -> Varies {
        let join = |parts: &[Handle<Expression>]| {
            parts.iter().map(|part| self.value(*part)).max().unwrap_or(Varies::Never)
        };
        match &self.function.expressions[handle] {
            Expression::Literal(_)
            | Expression::Constant(_)
            | Expression::Override(_)
            | Expression::ZeroValue(_) => Varies::Never,
            Expression::FunctionArgument(i) => self.arguments[*i as usize],
            Expression::GlobalVariable(variable) => {
                match self.module.global_variables[*variable].space {
                    AddressSpace::Uniform => Varies::ByDraw,
                    _ => Varies::Within,
                }
            }
            Expression::LocalVariable(variable) => {
                self.locals.get(variable).copied().unwrap_or(Varies::Never)
            }
            Expression::CallResult(_) => self.calls.get(&handle).copied().unwrap_or(Varies::Within),
            Expression::Load { pointer: part, .. }
            | Expression::AccessIndex { base: part, .. }
            | Expression::Splat { value: part, .. }
            | Expression::Swizzle { vector: part, .. }
            | Expression::Unary { expr: part, .. }
            | Expression::Relational { argument: part, .. }
            | Expression::As { expr: part, .. } => self.value(*part),
            Expression::Access { base, index } => join(&[*base, *index]),
            Expression::Binary { left, right, .. } => join(&[*left, *right]),
            Expression::Select { condition, accept, reject } => {
                join(&[*condition, *accept, *reject])
            }
            Expression::Compose { components, .. } => join(components),
            Expression::Math { arg, arg1, arg2, arg3, .. } => {
                let all = [Some(*arg), *arg1, *arg2, *arg3];
                join(&all.into_iter().flatten().collect::<Vec<_>>())
            }
            _ => Varies::Within,
        }
    }

    /// The local variable that a pointer points into.
    fn local(&self, pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
        match &self.function.expressions[pointer] {
            Expression::LocalVariable(variable) => Some(*variable),
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => {
                self.local(*base)
            }
            _ => None,
        }
    }

    fn store(&mut self, pointer: Handle<Expression>, varies: Varies) {
        if let Some(variable) = self.local(pointer) {
            let before = self.locals.entry(variable).or_insert(Varies::Never);
            *before = varies.max(*before);
        }
    }

    /// A branch; returns how what is stored behind it varies.
    fn branch(&mut self, condition: Handle<Expression>, within: Varies, place: Span) -> Varies {
        let varies = self.value(condition);
        if varies == Varies::ByDraw {
            self.found.push(place);
        }
        varies.max(within)
    }

    /// `within`: how it varies whether the block is run.
    fn block(&mut self, block: &Block, within: Varies) {
        for (statement, place) in block.span_iter() {
            match statement {
                Statement::Block(inner) => self.block(inner, within),
                Statement::If { condition, accept, reject } => {
                    let within = self.branch(*condition, within, *place);
                    self.block(accept, within);
                    self.block(reject, within);
                }
                Statement::Switch { selector, cases } => {
                    let within = self.branch(*selector, within, *place);
                    cases.iter().for_each(|case| self.block(&case.body, within));
                }
                Statement::Loop { body, continuing, break_if } => {
                    self.block(body, within);
                    self.block(continuing, within);
                    if let Some(condition) = break_if {
                        self.branch(*condition, within, *place);
                    }
                }
                Statement::Return { value } => {
                    let value = value.map_or(Varies::Never, |value| self.value(value));
                    self.result = self.result.max(value).max(within);
                }
                Statement::Store { pointer, value } => {
                    let varies = self.value(*pointer).max(self.value(*value)).max(within);
                    self.store(*pointer, varies);
                }
                Statement::Call { function, arguments, result } => {
                    let varies = arguments.iter().map(|value| self.value(*value)).collect();
                    let called = &self.module.functions[*function];
                    let (returned, found) = walk(self.module, called, varies);
                    self.found.extend(found);
                    if let Some(result) = result {
                        self.calls.insert(*result, returned);
                    }
                    // What a pointer leads to may have been changed to anything.
                    arguments.iter().for_each(|pointer| self.store(*pointer, Varies::Within));
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(body: &str) -> Vec<String> {
        let source = format!(
            "struct Frame {{ a: vec4<f32>, n: u32 }}
            @group(0) @binding(0) var<uniform> frame: Frame;
            @group(0) @binding(1) var<storage, read_write> out: array<f32>;
            override MODE: bool = false;
            fn is_far() -> bool {{ return frame.a.w == 0.0; }}
            fn chosen(limit: f32, x: f32) -> f32 {{
                var y = x;
                if limit > 0.0 {{ y = 1.0; }}
                return y;
            }}
            @compute @workgroup_size(1) fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
                let x = f32(id.x); {body} }}"
        );
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let text = |span: &Span| source[span.to_range().unwrap()].to_owned();
        uniform_branches(&module).iter().map(text).collect()
    }

    #[test]
    fn branches_of_a_whole_draw_are_found_however_they_are_written() {
        for body in [
            "if frame.a.x > 1.0 { out[0] = x; }",
            "let limit = frame.a.x; if (x > 1.0) || (limit > 0.0 && x > limit) { out[0] = x; }",
            "if is_far() { out[0] = x; }",
            "out[0] = chosen(frame.a.y, x);",
            "for (var i = 0u; i < frame.n; i++) { out[i] = x; }",
            "var y = 1.0; y *= frame.a.x; if x > 1.0 { if y > 0.0 { out[0] = x; } }",
            "switch frame.n { case 1u: { out[0] = x; } default: {} }",
        ] {
            assert_eq!(found(body).len(), 1, "{body}");
        }
    }

    #[test]
    fn other_branches_are_not() {
        for body in [
            "if x > frame.a.x { out[0] = 1.0; }",
            "if (x > 1.0) & is_far() { out[0] = 1.0; }",
            "if MODE { out[0] = x; }",
            "out[0] = chosen(x, x);",
            "for (var i = 0u; i < 3u; i++) { out[i] = select(x, 1.0, is_far()); }",
            "var y = 1.0; if x > 1.0 { y = frame.a.x; } if y > 0.0 { out[0] = x; }",
            "var y = 1.0; loop { if y > x { break; } y += x; } if y > 2.0 { out[0] = x; }",
            "if out[frame.n] > 0.0 { out[0] = x; }",
        ] {
            assert_eq!(found(body), [""; 0], "{body}");
        }
    }
}
