//! The expressions of a source file that can be made wrong.

use std::collections::HashMap;
use std::ops::Range;

use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Attribute, BinOp, Expr, Lit, Stmt, UnOp};

/// An expression, and a wrong one of the same type.
#[derive(Clone, Debug)]
pub struct Site {
    /// The same as long as the expression and what is around it stay, wherever the file has them.
    pub key: String,
    pub file: String,
    pub line: usize,
    /// Bytes of the file.
    pub range: Range<usize>,
    pub wrong: String,
    /// What is changed, for people.
    pub what: String,
    /// A statement, which cannot stand in parentheses.
    pub is_statement: bool,
}

impl Site {
    /// The text that chooses between right and wrong at run time.
    pub fn switched(&self, right: &str, number: usize, prefix: &str) -> String {
        let asked = format!("{prefix}::mutant({number})");
        match self.is_statement {
            true => format!("if !{asked} {{ {right} }}"),
            false => format!("(if {asked} {{ {} }} else {{ {right} }})", self.wrong),
        }
    }
}

/// All sites of a file.
///
/// # Errors
/// The file is no Rust.
pub fn of(file: &str, text: &str) -> Result<Vec<Site>, syn::Error> {
    let parsed = syn::parse_file(text)?;
    let mut finder = Finder {
        file,
        text,
        around: Vec::new(),
        depth: 0,
        times: HashMap::new(),
        sites: Vec::new(),
    };
    finder.visit_file(&parsed);
    Ok(finder.sites)
}

struct Finder<'a> {
    file: &'a str,
    text: &'a str,
    /// Names of the functions, types and modules around the place.
    around: Vec<String>,
    /// Number of functions around it that run when the program runs.
    depth: usize,
    times: HashMap<String, usize>,
    sites: Vec<Site>,
}

fn is_of_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let is = |name| attribute.path().is_ident(name);
        is("test")
            || (is("cfg")
                && attribute
                    .meta
                    .require_list()
                    .is_ok_and(|l| l.tokens.to_string() == "test"))
    })
}

/// The operator that stands for another one in a wrong program.
fn exchanged(op: &BinOp) -> Option<&'static str> {
    Some(match op {
        BinOp::Add(_) => "-",
        BinOp::Sub(_) => "+",
        BinOp::Mul(_) => "/",
        BinOp::Div(_) => "*",
        BinOp::AddAssign(_) => "-=",
        BinOp::SubAssign(_) => "+=",
        BinOp::MulAssign(_) => "/=",
        BinOp::DivAssign(_) => "*=",
        BinOp::And(_) => "||",
        BinOp::Or(_) => "&&",
        BinOp::Lt(_) | BinOp::Le(_) | BinOp::Gt(_) | BinOp::Ge(_) | BinOp::Eq(_) | BinOp::Ne(_) => {
            "!"
        }
        _ => return None,
    })
}

fn has_let(expression: &Expr) -> bool {
    match expression {
        Expr::Let(_) => true,
        Expr::Binary(e) => has_let(&e.left) || has_let(&e.right),
        _ => false,
    }
}

impl Finder<'_> {
    fn text_of(&self, range: &Range<usize>) -> &str {
        &self.text[range.clone()]
    }

    fn add(
        &mut self,
        range: Range<usize>,
        line: usize,
        wrong: String,
        what: String,
        is_statement: bool,
    ) {
        if self.depth == 0 {
            return;
        }
        let plain: String = self.text_of(&range).split_whitespace().collect();
        let key = format!("{}|{}|{plain}|{what}", self.file, self.around.join("::"));
        let times = self.times.entry(key.clone()).or_default();
        *times += 1;
        let key = format!("{key}|{times}");
        let file = self.file.to_owned();
        self.sites.push(Site {
            key,
            file,
            line,
            range,
            wrong,
            what,
            is_statement,
        });
    }

    fn inside(&mut self, name: String, deed: impl FnOnce(&mut Self)) {
        self.around.push(name);
        deed(self);
        self.around.pop();
    }

    /// A function: a constant one cannot ask which mutant runs.
    fn function(
        &mut self,
        name: &syn::Ident,
        attributes: &[Attribute],
        is_const: bool,
        deed: impl FnOnce(&mut Self),
    ) {
        if is_of_tests(attributes) || is_const {
            return;
        }
        self.depth += 1;
        self.inside(name.to_string(), deed);
        self.depth -= 1;
    }
}

fn bytes(spanned: &impl Spanned) -> Range<usize> {
    spanned.span().byte_range()
}

fn line(spanned: &impl Spanned) -> usize {
    spanned.span().start().line
}

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_of_tests(&item.attrs) {
            self.inside(item.ident.to_string(), |finder| {
                visit::visit_item_mod(finder, item)
            });
        }
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        if !is_of_tests(&item.attrs) {
            let of: String = self
                .text_of(&bytes(&item.self_ty))
                .split_whitespace()
                .collect();
            self.inside(of, |finder| visit::visit_item_impl(finder, item));
        }
    }

    // Constants cannot ask which mutant runs.
    fn visit_item_const(&mut self, _: &'ast syn::ItemConst) {}
    fn visit_item_static(&mut self, _: &'ast syn::ItemStatic) {}
    fn visit_impl_item_const(&mut self, _: &'ast syn::ImplItemConst) {}
    fn visit_trait_item_const(&mut self, _: &'ast syn::TraitItemConst) {}
    fn visit_type(&mut self, _: &'ast syn::Type) {}
    fn visit_pat(&mut self, _: &'ast syn::Pat) {}
    fn visit_expr_repeat(&mut self, _: &'ast syn::ExprRepeat) {}

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        let is_const = item.sig.constness.is_some();
        self.function(&item.sig.ident, &item.attrs, is_const, |finder| {
            visit::visit_block(finder, &item.block)
        });
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        let is_const = item.sig.constness.is_some();
        self.function(&item.sig.ident, &item.attrs, is_const, |finder| {
            visit::visit_block(finder, &item.block)
        });
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        let Some(block) = &item.default else { return };
        self.function(&item.sig.ident, &item.attrs, false, |finder| {
            visit::visit_block(finder, block)
        });
    }

    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        if let Stmt::Expr(Expr::MethodCall(call), Some(_)) = statement {
            let what = format!("`{}(..);` is left out", call.method);
            self.add(bytes(statement), line(statement), String::new(), what, true);
        }
        visit::visit_stmt(self, statement);
    }

    fn visit_expr_if(&mut self, branch: &'ast syn::ExprIf) {
        let range = bytes(&branch.cond);
        if !has_let(&branch.cond) && !matches!(*branch.cond, Expr::Binary(_)) {
            let wrong = format!("!({})", self.text_of(&range));
            self.add(
                range,
                line(&branch.cond),
                wrong,
                "condition negated".to_owned(),
                false,
            );
        }
        visit::visit_expr_if(self, branch);
    }

    fn visit_expr_binary(&mut self, binary: &'ast syn::ExprBinary) {
        let of = Expr::Binary(binary.clone());
        if let Some(other) = exchanged(&binary.op).filter(|_| !has_let(&of)) {
            let [left, op, right] = [bytes(&binary.left), bytes(&binary.op), bytes(&binary.right)];
            let op = self.text_of(&op).to_owned();
            let (wrong, what) = match other {
                "!" => (
                    format!("!({})", self.text_of(&bytes(binary))),
                    format!("`{op}` negated"),
                ),
                _ => (
                    format!("{} {other} {}", self.text_of(&left), self.text_of(&right)),
                    format!("`{op}` is `{other}`"),
                ),
            };
            self.add(bytes(binary), line(binary), wrong, what, false);
        }
        visit::visit_expr_binary(self, binary);
    }

    fn visit_expr_unary(&mut self, unary: &'ast syn::ExprUnary) {
        let op = match unary.op {
            UnOp::Neg(_) => Some("-"),
            UnOp::Not(_) => Some("!"),
            _ => None,
        };
        if let Some(op) = op {
            let inner = self.text_of(&bytes(&unary.expr)).to_owned();
            self.add(
                bytes(unary),
                line(unary),
                inner,
                format!("`{op}` is left out"),
                false,
            );
        }
        visit::visit_expr_unary(self, unary);
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        let other = match call.method.to_string().as_str() {
            "min" => "max",
            "max" => "min",
            "any" => "all",
            "all" => "any",
            "max_by" => "min_by",
            "min_by" => "max_by",
            "is_some" => "is_none",
            "is_none" => "is_some",
            _ => "",
        };
        if !other.is_empty() {
            let (whole, name) = (bytes(call), bytes(&call.method));
            let (head, tail) = (whole.start..name.start, name.end..whole.end);
            let wrong = format!("{}{other}{}", self.text_of(&head), self.text_of(&tail));
            self.add(
                whole,
                line(&call.method),
                wrong,
                format!("`{}` is `{other}`", call.method),
                false,
            );
        }
        visit::visit_expr_method_call(self, call);
    }

    fn visit_expr_lit(&mut self, literal: &'ast syn::ExprLit) {
        if let Lit::Float(number) = &literal.lit
            && number.base10_parse::<f64>().is_ok_and(|value| value != 0.0)
        {
            let text = self.text_of(&bytes(literal)).to_owned();
            self.add(
                bytes(literal),
                line(literal),
                format!("2.0 * {text}"),
                format!("`{text}` is twice as large"),
                false,
            );
        }
    }
}
