# Report.pm: what scripts/report does with its figures: kept from run to run, as tables, as curves
# with their Pareto front, and as one page of HTML.
package Report;
use strict;
use warnings;
use JSON::PP ();

# dir: of the report. total: cells that there will be, for the progress line.
sub new {
    my ($class, $dir, $total) = @_;
    my $self = bless { dir => $dir, total => $total, done => 0, body => '', start => time, fresh => 0 }, $class;
    mkdir $_ for $dir, "$dir/cells", "$dir/pictures";
    return $self;
}

# ---- cells: one measurement each, which an earlier run may have made already ----

# The figures that make_it returns, a hash, kept under that name. A cell that failed is a hash with
# the one member "failed", its message, and is tried again the next time.
sub cell {
    my ($self, $name, $make_it) = @_;
    my $file = "$self->{dir}/cells/" . ($name =~ s/[^\w.+-]/_/gr) . '.json';
    $self->{done}++;
    $self->progress($name);
    if (open my $f, '<', $file) {
        my $known = eval { JSON::PP::decode_json(join '', <$f>) };
        return $known if ref $known eq 'HASH';
    }
    my $new = eval { $make_it->() };
    if (!$new) {
        chomp(my $why = $@);
        print STDERR "\r\033[K" if -t STDERR;
        print STDERR "report: $name: $why\n";
        return { failed => $why };
    }
    $self->{fresh}++;
    open my $f, '>', "$file.new" or die "$file.new: $!\n";
    print $f JSON::PP->new->canonical->encode($new);
    close $f or die "$file.new: $!\n";
    rename "$file.new", $file or die "$file: $!\n";
    return $new;
}

sub progress {
    my ($self, $name) = @_;
    return unless -t STDERR;
    printf STDERR "\r\033[K%d/%d, %d s: %s", $self->{done}, $self->{total}, time - $self->{start}, $name;
    print STDERR "\r\033[K" if $self->{done} >= $self->{total};
}

# ---- tables ----

sub number {
    my $v = shift;
    return '-' unless defined $v;
    return $v unless $v =~ /^-?[\d.]+(e[-+]?\d+)?$/i;
    return $v if $v =~ /^-?\d+$/;
    return $v == 0 ? '0' : abs $v >= 1e5 || abs $v < 1e-3 ? sprintf('%.3g', $v) : sprintf('%.4g', $v);
}

sub escape { my $t = shift; $t =~ s/&/&amp;/g; $t =~ s/</&lt;/g; $t =~ s/>/&gt;/g; $t =~ s/"/&quot;/g; return $t }

sub html { my $self = shift; $self->{body} .= join '', @_, "\n" }
sub heading { my ($self, $text) = @_; $self->html('<h2>', escape($text), '</h2>') }
sub text { my ($self, @text) = @_; $self->html('<p>', join(' ', @text), '</p>') }

# rows: hashes; columns: their members in order. Also written as NAME.tsv. A row with the member
# "mark" (default, pareto) is shown so.
sub table {
    my ($self, $name, $columns, $rows) = @_;
    open my $f, '>', "$self->{dir}/$name.tsv" or die "$self->{dir}/$name.tsv: $!\n";
    print $f join("\t", @$columns), "\n";
    print $f join("\t", map { $_ // '' } @$_{@$columns}), "\n" for @$rows;
    close $f or die "$name.tsv: $!\n";
    my $t = '<div class="wide"><table><tr>' . join('', map { '<th>' . escape($_) . '</th>' } @$columns) . '</tr>';
    for my $row (@$rows) {
        my $mark = $row->{mark} // '';
        $t .= qq(<tr class="$mark">) . join('', map { '<td>' . escape(number($_)) . '</td>' } @$row{@$columns}) . '</tr>';
    }
    $self->html($t, '</table></div>', qq(<p class="file"><a href="$name.tsv">$name.tsv</a></p>));
}

# Of points with a price and an error, those that nothing beats in both.
sub pareto {
    my ($rows, $price, $error) = @_;
    my ($least, @front) = (9**9**9);
    for my $row (sort { $a->{$price} <=> $b->{$price} || $a->{$error} <=> $b->{$error} } grep { defined $_->{$error} } @$rows) {
        next unless $row->{$error} < $least;
        $least = $row->{$error};
        push @front, $row;
    }
    return @front;
}

# ---- curves ----

sub have_gnuplot { return !system('command -v gnuplot >/dev/null 2>&1') }

# Series: [label, rows]; a cross is the default's, the grey line the Pareto front of all. Drawn as
# NAME.svg and into the page. better: 'less' or 'more' of y.
sub plot {
    my ($self, $name, %how) = @_;
    my ($x, $y) = @how{qw(x y)};
    my @series = grep { @{ $_->[1] } } map { my $s = $_; [$s->[0], [grep { ($_->{$x} // 0) > 0 && ($how{linear} || ($_->{$y} // 0) > 0) && defined $_->{$y} } @{ $s->[1] }]] } @{ $how{series} };
    return unless @series;
    unless (have_gnuplot()) { $self->text("No plot $name: gnuplot is not installed."); return }
    my @all = map { @{ $_->[1] } } @series;
    my $data = "$self->{dir}/cells/$name.dat";
    open my $f, '>', $data or die "$data: $!\n";
    my @plots;
    my $block = sub { print $f map({ "$_->{$x} $_->{$y}\n" } @{ $_[0] }), "\n\n" };
    my @front = $how{better} eq 'more' ? pareto([map { { %$_, minus => -$_->{$y} } } @all], $x, 'minus') : pareto(\@all, $x, $y);
    my @defaults = grep { ($_->{mark} // '') eq 'default' } @all;
    my $index = 0;
    for (['Pareto front', \@front, q(with steps lw 5 lc rgb '#b0b0b0')], map({ [@$_, 'with linespoints pt 7 ps 0.5'] } @series), ['default', \@defaults, q(with points pt 2 ps 1.6 lw 2 lc rgb '#d02020')]) {
        my ($label, $rows, $style) = @$_;
        next unless @$rows;
        $block->([sort { $a->{$x} <=> $b->{$x} } @$rows]);
        $label =~ s/'/''/g;
        push @plots, "'$data' index $index title '$label' $style";
        $index++;
    }
    close $f or die "$data: $!\n";
    my $log = $how{linear} ? 'set logscale x' : 'set logscale xy';
    open my $g, '|-', 'gnuplot' or die "gnuplot: $!\n";
    print $g "set terminal svg size 760,420 dynamic font 'sans,13'; set output '$self->{dir}/$name.svg'; $log; set grid lc rgb '#cccccc';
        set key outside top center horizontal noenhanced; set xlabel '$how{xlabel}'; set ylabel '$how{ylabel}'; plot ", join(', ', @plots), "\n";
    close $g or do { $self->text("No plot $name: gnuplot failed."); return };
    open my $s, '<', "$self->{dir}/$name.svg" or die "$name.svg: $!\n";
    my $svg = join '', <$s>;
    $svg =~ s/^.*?(?=<svg)//s;
    # Names of several drawings in one page must not be the same.
    $svg =~ s/\b(id="|href="#|href='#|url\(#)gp/$1${name}_gp/g;
    $svg =~ s/\bid="gnuplot_plot/id="${name}_plot/g;
    $svg =~ s/<svg/<svg role="img" aria-label="$name"/;
    $self->html('<figure>', $svg, '<figcaption>', escape($how{caption}), '</figcaption></figure>');
}

# A picture (PNG) inside of the page.
sub picture {
    my ($self, $file, $caption) = @_;
    open my $f, '<:raw', $file or return;
    local $/;
    require MIME::Base64;
    my $bytes = MIME::Base64::encode_base64(<$f>, '');
    $self->html(qq(<figure class="picture"><img alt="), escape($caption), qq(" src="data:image/png;base64,$bytes"><figcaption>), escape($caption), '</figcaption></figure>');
}

# ---- the page ----

sub page {
    my ($self, $title, $lead) = @_;
    open my $f, '>', "$self->{dir}/report.html" or die "$self->{dir}/report.html: $!\n";
    print $f <<"HTML";
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>@{[escape($title)]}</title>
<style>
:root { color-scheme: light dark; --line: #ccc; --soft: #f4f4f2 }
body { font: 16px/1.5 sans-serif; max-width: 56rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; font-size: 0.82rem; font-variant-numeric: tabular-nums }
th, td { text-align: right; padding: 0.15rem 0.6rem; border-bottom: 1px solid var(--line); white-space: nowrap }
th:first-child, td:first-child { text-align: left }
tr.default td { font-weight: bold } tr.pareto td { background: var(--soft) }
.wide { overflow-x: auto } .file { font-size: 0.8rem; margin-top: 0.2rem }
figure { margin: 1rem 0 } figure svg { width: 100%; height: auto } figcaption { font-size: 0.85rem }
figure.picture { display: inline-block; width: 19%; margin: 0 0.5% } figure.picture img { width: 100% }
pre { background: var(--soft); padding: 0.8rem; overflow-x: auto }
\@media (prefers-color-scheme: dark) {
    :root { --line: #444; --soft: #242424 } body { background: #161616; color: #ddd }
    figure svg { filter: invert(0.9) hue-rotate(180deg) } a { color: #8ab4f8 }
}
</style></head><body>
<h1>@{[escape($title)]}</h1>
<p>$lead</p>
$self->{body}</body></html>
HTML
    close $f or die "report.html: $!\n";
}

1;
