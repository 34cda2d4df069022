//! Places in a source file where a small mistake can stand beside what is written.

use std::ops::Range;

use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Attribute, BinOp, Expr, ExprUnary, Lit, Stmt, UnOp};

/// A mistake: the text of an expression or a statement, and another text for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    /// Bytes of the file.
    pub range: Range<usize>,
    /// Line, from 1.
    pub line: usize,
    /// What would stand there.
    pub wrong: String,
    /// Whether it is a whole statement, which has no value.
    pub statement: bool,
}

/// All sites of a file, in order. Tests, constants and what macros contain have none.
pub fn sites(text: &str) -> syn::Result<Vec<Site>> {
    let file = syn::parse_file(text)?;
    let mut finder = Finder {
        text,
        found: Vec::new(),
    };
    finder.visit_file(&file);
    Ok(finder.found)
}

struct Finder<'a> {
    text: &'a str,
    found: Vec<Site>,
}

fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|a| {
        a.path().is_ident("test")
            || (a.path().is_ident("cfg") && {
                let syn::Meta::List(list) = &a.meta else {
                    return false;
                };
                list.tokens.to_string() == "test"
            })
    })
}

impl Finder<'_> {
    fn add(&mut self, whole: &impl Spanned, wrong: String) {
        self.push(whole, wrong, false);
    }

    fn push(&mut self, whole: &impl Spanned, wrong: String, statement: bool) {
        let span = whole.span();
        let site = Site {
            range: span.byte_range(),
            line: span.start().line,
            wrong,
            statement,
        };
        self.found.push(site);
    }

    /// The text of `whole` with that of a part replaced.
    fn with(&self, whole: &impl Spanned, part: &impl Spanned, by: &str) -> String {
        let (whole, part) = (whole.span().byte_range(), part.span().byte_range());
        let [before, after] = [whole.start..part.start, part.end..whole.end];
        format!("{}{by}{}", &self.text[before], &self.text[after])
    }

    fn text_of(&self, part: &impl Spanned) -> String {
        self.text[part.span().byte_range()].to_owned()
    }
}

/// The operator that takes the place of another one; `None` for those that have no like.
fn other(operator: &BinOp) -> Option<&'static str> {
    Some(match operator {
        BinOp::Add(_) => "-",
        BinOp::Sub(_) => "+",
        BinOp::Mul(_) => "/",
        BinOp::Div(_) => "*",
        BinOp::And(_) => "||",
        BinOp::Or(_) => "&&",
        // Not the boundary alone, which changes nothing for two numbers that are never equal.
        BinOp::Lt(_) => ">=",
        BinOp::Le(_) => ">",
        BinOp::Gt(_) => "<=",
        BinOp::Ge(_) => "<",
        BinOp::Eq(_) => "!=",
        BinOp::Ne(_) => "==",
        BinOp::AddAssign(_) => "-=",
        BinOp::SubAssign(_) => "+=",
        BinOp::MulAssign(_) => "/=",
        BinOp::DivAssign(_) => "*=",
        BinOp::BitOrAssign(_) => "&=",
        _ => return None,
    })
}

/// Whether a condition has a `let`, which stands nowhere but in a condition.
fn binds(condition: &Expr) -> bool {
    match condition {
        Expr::Let(_) => true,
        Expr::Binary(binary) => binds(&binary.left) || binds(&binary.right),
        _ => false,
    }
}

/// What a method does wrong: another one in its place, or nothing.
fn other_method(name: &str) -> Option<&'static str> {
    Some(match name {
        "min" => "max",
        "max" => "min",
        "any" => "all",
        "all" => "any",
        "abs" | "sqrt" | "neg" | "normalize" | "inverse" | "transpose" | "rev" => "",
        _ => return None,
    })
}

impl<'a> Visit<'a> for Finder<'_> {
    fn visit_item_mod(&mut self, item: &'a syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'a syn::ItemFn) {
        // A function that runs at compile time cannot ask which mistake is made.
        if !is_test(&item.attrs) && item.sig.constness.is_none() {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'a syn::ImplItemFn) {
        if !is_test(&item.attrs) && item.sig.constness.is_none() {
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_item_impl(&mut self, item: &'a syn::ItemImpl) {
        let of = item.trait_.as_ref().and_then(|(_, path, _)| path.segments.last());
        // What a type prints for a developer is no result.
        if !is_test(&item.attrs) && of.is_none_or(|name| name.ident != "Debug") {
            visit::visit_item_impl(self, item);
        }
    }

    fn visit_item_const(&mut self, _: &'a syn::ItemConst) {}
    fn visit_item_static(&mut self, _: &'a syn::ItemStatic) {}
    fn visit_impl_item_const(&mut self, _: &'a syn::ImplItemConst) {}
    fn visit_trait_item_const(&mut self, _: &'a syn::TraitItemConst) {}
    fn visit_variant(&mut self, _: &'a syn::Variant) {}
    fn visit_type(&mut self, _: &'a syn::Type) {}
    fn visit_pat(&mut self, _: &'a syn::Pat) {}
    fn visit_attribute(&mut self, _: &'a Attribute) {}
    fn visit_generic_argument(&mut self, _: &'a syn::GenericArgument) {}
    fn visit_expr_const(&mut self, _: &'a syn::ExprConst) {}

    fn visit_expr_repeat(&mut self, repeat: &'a syn::ExprRepeat) {
        // Its length is a constant.
        self.visit_expr(&repeat.expr);
    }

    fn visit_stmt(&mut self, statement: &'a Stmt) {
        if let Stmt::Expr(Expr::MethodCall(_) | Expr::Call(_), Some(_)) = statement {
            self.push(statement, String::new(), true);
        }
        visit::visit_stmt(self, statement);
    }

    fn visit_expr_binary(&mut self, binary: &'a syn::ExprBinary) {
        if let Some(operator) = other(&binary.op).filter(|_| !binds(&binary.left) && !binds(&binary.right)) {
            let wrong = self.with(binary, &binary.op, operator);
            self.add(binary, wrong);
        }
        visit::visit_expr_binary(self, binary);
    }

    fn visit_expr_unary(&mut self, unary: &'a ExprUnary) {
        if matches!(unary.op, UnOp::Neg(_) | UnOp::Not(_)) {
            let wrong = self.text_of(&unary.expr);
            self.add(unary, wrong);
        }
        visit::visit_expr_unary(self, unary);
    }

    fn visit_expr_method_call(&mut self, call: &'a syn::ExprMethodCall) {
        match other_method(&call.method.to_string()) {
            Some("") if call.args.is_empty() => {
                let wrong = self.text_of(&call.receiver);
                self.add(call, wrong);
            }
            Some("") | None => {}
            Some(other) => {
                let wrong = self.with(call, &call.method, other);
                self.add(call, wrong);
            }
        }
        visit::visit_expr_method_call(self, call);
    }

    fn visit_expr_lit(&mut self, literal: &'a syn::ExprLit) {
        let Lit::Float(number) = &literal.lit else {
            return;
        };
        let wrong = match number.base10_parse::<f64>() {
            Ok(0.0) => "1.0".to_owned(),
            Ok(_) => format!("(2.0 * {})", self.text_of(literal)),
            Err(_) => return,
        };
        self.add(literal, wrong);
    }

    fn visit_expr_if(&mut self, branch: &'a syn::ExprIf) {
        // A condition of one call or name; others are found by their operators.
        if let Expr::MethodCall(_) | Expr::Call(_) | Expr::Path(_) | Expr::Field(_) = &*branch.cond {
            let wrong = format!("!({})", self.text_of(&branch.cond));
            self.add(&branch.cond, wrong);
        }
        visit::visit_expr_if(self, branch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong(text: &str) -> Vec<String> {
        let found = sites(text).expect("a file");
        found.into_iter().map(|site| site.wrong).collect()
    }

    #[test]
    fn each_kind_of_mistake() {
        assert_eq!(
            wrong("fn f() { let x = a + b * 2.5; }"),
            ["a - b * 2.5", "b / 2.5", "(2.0 * 2.5)"]
        );
        assert_eq!(wrong("fn f() { x += -y; }"), ["x -= -y", "y"]);
        assert_eq!(wrong("fn f() { a.push(b.abs().min(c)); }"), ["", "b.abs().max(c)", "b"]);
        assert_eq!(wrong("fn f() { if done() { } }"), ["!(done())"]);
        assert_eq!(wrong("fn f() { if a < b && !c { } }"), ["a < b || !c", "a >= b", "c"]);
    }

    #[test]
    fn what_has_no_mistake() {
        let none: [String; 0] = [];
        for text in [
            "const A: f64 = 1.0 + 2.0;",
            "const fn f() -> usize { 1 + 2 }",
            "#[cfg(test)] mod tests { fn f() -> f64 { 1.0 + 2.0 } }",
            "fn f() -> [u8; 2 + 3] { [0; 2 + 3] }",
            "fn f() { assert!(1.0 + 2.0 < 3.0); }",
            "fn f() { if let Some(x) = y && let Some(z) = x { } }",
            "fn f() { match x { 1.0 => (), _ => () } }",
        ] {
            assert_eq!(wrong(text), none, "{text}");
        }
    }
}
